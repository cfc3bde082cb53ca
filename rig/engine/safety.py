"""Command the safe state, in which the load frame holds its position and the stage stands still."""

import math
from collections.abc import Callable

from drivers.clock import Clock, Event, SystemClock
from rig.devices import Rig
from rig.threads import DeviceThread

STOP_DEADLINE_S = 15.0
"""Time limit for the confirmation of the safe state, in s of real time.

The limit is longer than the time for which a driver repeats a command without an answer."""


class SafeState:
    """Commands the safe state of a rig. Each command has a thread of its own.

    Because of the threads, a device without an answer cannot block the stop of the other device or the end of
    the run. A signal handler may interrupt a call that holds a device's lock, and the threads can then still
    command the safe state.

    `deadline_s` is the time limit for the confirmation by each device, in real time. `confirmed` are the
    devices that have confirmed the last call of `confirm`.
    """

    def __init__(self, rig: Rig, deadline_s: float = STOP_DEADLINE_S) -> None:
        self._clock = rig.clock
        self._deadline_s = deadline_s
        self._commands: dict[str, Callable[[], None]] = {}
        if rig.load_frame is not None:
            self._commands["load_frame"] = rig.load_frame.hold
        if rig.stage is not None:
            self._commands["stage"] = rig.stage.stop
        self._commanded: list[_Attempt] = []
        self.confirmed: frozenset[str] = frozenset()

    def command(self) -> None:
        """Command the safe state without waiting. Skip a device whose previous command is still running."""
        for device, command in self._commands.items():
            if all(attempt.device != device or attempt.done.is_set() for attempt in self._commanded):
                attempt = _Attempt(device, command, self._deadline_s, self._clock)
                self._commanded.append(attempt)
                attempt.begin()

    def confirm(self, meanwhile: Callable[[], None] = lambda: None) -> list[str]:
        """Command the safe state and wait. Return one sentence for each device that did not confirm.

        `meanwhile` is called after all commands have started and before the wait, and must not raise an
        exception.
        """
        attempts = [
            _Attempt(device, command, self._deadline_s, self._clock)
            for device, command in self._commands.items()
        ]
        for attempt in attempts:
            attempt.begin()
        meanwhile()
        end_s = SystemClock().now_s() + self._deadline_s
        for attempt in attempts + self._commanded:
            self._clock.wait(attempt.done, math.inf, max(0.0, end_s - SystemClock().now_s()))
            attempt.give_up()
        self.confirmed = frozenset(attempt.device for attempt in attempts if not attempt.failure)
        return [attempt.failure for attempt in attempts if attempt.failure]


class _Attempt(DeviceThread):
    """One command to one device. `failure` says why the device did not confirm, or is empty."""

    def __init__(self, device: str, command: Callable[[], None], deadline_s: float, clock: Clock) -> None:
        super().__init__(f"safe state of {device}")
        self.device = device
        self.failure = f"{device}: no confirmation within {deadline_s:g} s"
        self.done = Event()
        self._command = command
        # On a simulated clock, let no time pass until both devices have been commanded.
        self._activity = clock.activity(at_once=True)

    def begin(self) -> None:
        try:
            self.start()
        except RuntimeError:
            # The system cannot start more threads, so command one device after the other.
            self.run()

    def give_up(self) -> None:
        self._activity.end()

    def run(self) -> None:
        with self._activity:
            try:
                self._command()
            except BaseException as error:
                self.failure = str(error) or type(error).__name__
            else:
                self.failure = ""
            self.done.set()
