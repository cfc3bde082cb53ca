"""An output line that gives pulses of one length: never two as one, and at rest at the end.

A pulse begins during the call that asks for it. A thread ends it after its width.
"""

import threading
from collections.abc import Callable

from drivers.clock import Activity, Clock, Event
from drivers.errors import DeviceError, DeviceFault, LinkLost

LAST_PULSE_S = 1.0
"""Longest time, in seconds, for which closing lets the last pulse go on."""
CLOSING_S = 5.0
"""Longest real time, in seconds, for which closing waits for the end of the last pulse."""


class PulseLine:
    """The pulses of one line.

    Parameters
    ----------
    device : str
        Name of the device in messages.
    clock : Clock
    width_s : float
        Length of a pulse.
    width_key : str
        Name of the setting with the length, and its value, for messages.
    put : callable
        ``put(on, step)`` puts the line into the state of a pulse or of rest, and raises `DeviceError` if this
        is not certain. `step` is the step for messages. Two threads never call it at the same time, unless
        the caller of `rest` is one of them.
    """

    def __init__(
        self, device: str, clock: Clock, width_s: float, width_key: str, put: Callable[[bool, str], None]
    ) -> None:
        self._device, self._clock = device, clock
        self._width_s, self._width_key, self._put = width_s, width_key, put
        self._turn = threading.Lock()
        # set when no pulse is being given
        self._over = Event()
        self._over.set()
        self._cut = Event()
        self._closed = False
        self._resting = False
        # the reason why the last pulse did not end in time
        self._failure: DeviceError | None = None

    def rest(self) -> None:
        """Put the line into its state of rest. Raise `DeviceError` if this is not certain."""
        self._put(False, "put the output at rest")
        self._resting = True

    def pulse(self) -> None:
        """Begin a pulse and return. The pulse ends by itself after its width.

        Raise `DeviceFault` if the pulse before has not ended yet, or if it did not end in time. Raise
        `DeviceError` if the device does not confirm this pulse, which may still have been given.
        """
        with self._turn:
            if self._closed:
                raise LinkLost(self._device, "pulse", "an open device", "a closed one", "open it again")
            if not self._over.is_set():
                raise DeviceFault(
                    self._device,
                    "pulse",
                    "an output at rest",
                    "the pulse before, which has not ended",
                    f"give pulses less often, or make {self._width_key} shorter",
                )
            if not self._resting:
                self.rest()
            self._require_ended()
            self._give()

    def close(self) -> None:
        """Leave the line at rest. A pulse goes on for at most one second. A repeated call has no effect.

        Raise `DeviceError` if the line may not be at rest, or if the last pulse did not end in time.
        """
        with self._turn:
            if self._closed:
                return
            self._closed = True
        self._clock.wait(self._over, LAST_PULSE_S, real_timeout_s=CLOSING_S)
        self._cut.set()
        self._clock.wait(self._over, CLOSING_S, real_timeout_s=CLOSING_S)
        if not self._resting:
            self.rest()
        self._require_ended()

    def _give(self) -> None:
        self._resting = False
        self._over.clear()
        given = False
        try:
            self._put(True, "pulse")
            given = True
        finally:
            # Without a confirmation the line may be on all the same, so the pulse must end.
            ending = threading.Thread(
                target=self._end,
                args=(self._clock.activity(), given),
                name=f"pulse {self._device}",
                daemon=True,
            )
            ending.start()

    def _end(self, activity: Activity, given: bool) -> None:
        """End the pulse after its width. This method runs on a thread of its own."""
        with activity:
            try:
                self._clock.wait(self._cut, self._width_s)
                self.rest()
            except DeviceError as error:
                # an error of the beginning of the pulse has been raised already
                self._failure = error if given else None
            finally:
                self._over.set()

    def _require_ended(self) -> None:
        """Raise `DeviceFault` if the last pulse did not end in time. The error is raised only once."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise DeviceFault(
                failure.device,
                "end the pulse before",
                f"an output at rest after {self._width_s:g} s",
                f"{failure.got} ({failure.step}, expected {failure.expected}), so the pulse was longer",
                failure.remedy,
            )
