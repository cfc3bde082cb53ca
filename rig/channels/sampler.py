"""A thread that takes all samples of one channel device, records them, and tells when they fail to come."""

import math
import threading
from collections.abc import Callable

import numpy as np

from drivers.clock import Activity, Clock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.signals import ChannelDevice, Samples
from rig.channels.readings import Readings
from rig.channels.time_line import TimeLine
from rig.samples import TimedSamples
from rig.threads import DeviceThread, error_of_driver

_READ_S = 0.25
"""Longest wait in s for a sample, before the thread looks whether it is to end."""
_SILENCE_S, _SILENT_SAMPLES = 1.0, 10.0
HANG_S = 5.0
"""A call may take this time in s longer than the driver was told, before it counts as hanging."""
_FIRST_S, _FIRST_UNRATED_S, _FIRST_SAMPLES = 5.0, 30.0, 3.0
"""Longest wait in s for the first sample, with and without a fixed rate, and least number of intervals."""
_TOLD_S = 10.0
"""Shortest time in s between two sentences about lost samples."""
ENDING_S = 2.0
"""Real time in s in which the thread must end."""


class Sampler(DeviceThread):
    """Reads one device until it is stopped or fails.

    Parameters
    ----------
    name : str
        The device's name in messages, such as ``channels.box``.
    device : ChannelDevice
    clock : Clock
    record : callable
        Called with all samples in their order, on the thread of the sampler.
    hang_s : float
        See `HANG_S`.
    any_value : bool
        True if a value out of its range is no fault, as for a check of the rig.

    Attributes
    ----------
    count, lost : int
        Number of samples, and of samples that are missing between them.
    newest_s : float
        Time of the newest sample on the rig's clock, -inf before the first one.
    """

    def __init__(
        self,
        name: str,
        device: ChannelDevice,
        clock: Clock,
        record: Callable[[TimedSamples], None],
        hang_s: float = HANG_S,
        any_value: bool = False,
    ) -> None:
        super().__init__(f"samples of {name}")
        self._device_name, self._device, self._clock = name, device, clock
        self._record, self._hang_s, self._any_value = record, hang_s, any_value
        self._readings = Readings(device.signals)
        self.take = self._readings.take
        self._time_line = TimeLine(name)
        usual_s = max(_SILENCE_S, _SILENT_SAMPLES / device.rate_hz) if device.rate_hz else np.inf
        self._silence_s: float = getattr(device, "silence_s", usual_s)
        self._heard_s = self._begun_s = clock.now_s()
        self._called_s = math.inf
        self._next: int | None = None
        self.count = self.lost = self._told = 0
        self._told_s = -math.inf
        self._lost_before = 0
        self.newest_s = -math.inf
        self._ending = threading.Event()
        self._error: BaseException | None = None
        self._activity: Activity | None = None

    def begin(self) -> None:
        """Begin to read."""
        self._heard_s = self._begun_s = self._clock.now_s()
        self._activity = self._clock.activity()
        self.start()

    @property
    def is_ready(self) -> bool:
        """True if there is a sample. Raise the device's error, or `DeviceTimeout` if none comes for long."""
        self._require_running()
        if self.count:
            return True
        rate_hz, waited_s = self._device.rate_hz, self._clock.now_s() - self._begun_s
        longest_s = max(_FIRST_S, _FIRST_SAMPLES / rate_hz) if rate_hz else _FIRST_UNRATED_S
        # a device that may be silent for longer is waited for longer
        if waited_s > max(longest_s, self._silence_s if self._silence_s < np.inf else 0.0):
            raise self._silence(waited_s)
        return False

    def check(self) -> None:
        """Raise the error that ended the thread, and `DeviceTimeout` if the device is silent or hangs."""
        self._require_running()
        silent_s = self._clock.now_s() - self._heard_s
        if silent_s > self._silence_s + _READ_S:
            raise self._silence(silent_s)

    def has_passed(self, time_s: float) -> bool:
        """Return whether the samples reach a time of the measured quantity. Without a fixed rate they do."""
        latest_s = time_s + max(signal.delay_s for signal in self._device.signals)
        return self._device.rate_hz == 0.0 or self.newest_s >= latest_s

    def new_losses(self, *, whole: bool = False) -> str:
        """Return a sentence about samples that were lost and not told yet, or an empty text.

        Only with `whole`, the sentence comes also soon after another one.
        """
        lost, now_s = self.lost, self._clock.now_s()
        if lost == self._told or (now_s - self._told_s < _TOLD_S and not whole):
            return ""
        new, self._told, self._told_s = lost - self._told, lost, now_s
        return f"{self._device_name}: {new} samples before sample {self._lost_before} were lost"

    def ask_to_stop(self) -> None:
        """Let the thread end, without waiting."""
        self._ending.set()
        if self._activity is not None:
            self._activity.end()

    def stop(self) -> bool:
        """End the thread. Return False if the driver hangs."""
        self.ask_to_stop()
        if self._activity is None:
            return True
        self.join(ENDING_S)
        return not self.is_alive()

    def run(self) -> None:
        """Take all samples. This method runs on the thread."""
        assert self._activity is not None
        try:
            with self._activity:
                while not self._ending.is_set():
                    self._step()
        except BaseException as error:
            if not self._ending.is_set():
                self._error = error_of_driver(self._device_name, "read", error)

    def _require_running(self) -> None:
        if self._error is not None:
            raise self._error
        if self._clock.now_s() - self._called_s > _READ_S + self._hang_s:
            raise DeviceTimeout(
                self._device_name,
                "read",
                f"an answer or an error within {_READ_S:g} s",
                "none: the call hangs",
                "check the device and its cable, and report the hanging call to the author of its driver",
            )

    def _step(self) -> None:
        try:
            self._called_s = self._clock.now_s()
            samples = self._device.read(_READ_S)
            self._called_s = math.inf
        except DeviceTimeout as error:
            self._called_s = math.inf
            # a slow device, or one without a fixed rate, may be silent for some time
            silent_s = self._clock.now_s() - self._heard_s
            if silent_s > self._silence_s:
                # The driver knows only for how long it waited this time.
                raise self._silence(silent_s, error.remedy) from error
            return
        self._heard_s = self._clock.now_s()
        timed = self._timed(samples)
        self._count(samples)
        self._record(timed)
        if not self._any_value:
            self._require_valid(timed)
        self._readings.add(timed)
        self.newest_s = float(timed.time_s[-1])
        self.count += len(timed.values)

    def _timed(self, samples: Samples) -> TimedSamples:
        time_s, time_std_s = self._time_line.of(samples)
        device_s = np.full(len(time_s), np.nan) if samples.device_s is None else samples.device_s
        # Copy the values, because a driver may use its buffer again before they are on the disk.
        values = np.array(samples.values, np.float64)
        return TimedSamples(values, time_s, time_std_s, device_s, samples.first)

    def _count(self, samples: Samples) -> None:
        lost = 0 if self._next is None else samples.first - self._next
        if lost < 0:
            raise DeviceFault(
                self._device_name,
                "read",
                f"sample {self._next}",
                f"sample {samples.first} again",
                "mend the driver, which returns samples twice",
            )
        if lost:
            self._lost_before = samples.first
            self.lost += lost
        self._next = samples.first + len(samples.values)

    def _require_valid(self, timed: TimedSamples) -> None:
        for k, signal in enumerate(self._device.signals):
            values = timed.values[:, k]
            # Write the comparison so that NaN is outside.
            outside = ~((values >= signal.low) & (values <= signal.high))
            if outside.any():
                value = values[outside][0]
                raise DeviceFault(
                    self._device_name,
                    "read",
                    f"{signal.name} within {signal.low:g} to {signal.high:g} {signal.unit}",
                    "no valid value" if np.isnan(value) else f"{value:.10g} {signal.unit}",
                    "check the sensor, its amplifier and its cable; if the value is right, widen the range "
                    f"of {signal.name} in the rig file",
                )

    def _silence(self, silent_s: float, remedy: str = "check the device and its cable") -> DeviceTimeout:
        return DeviceTimeout(
            self._device_name,
            "read",
            f"a sample every {1.0 / self._device.rate_hz:g} s" if self._device.rate_hz else "a sample",
            f"none for {silent_s:.2g} s",
            remedy,
        )
