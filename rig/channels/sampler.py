"""A thread that takes all samples of one channel device, records them, and tells when they fail to come."""

import threading
from collections.abc import Callable

import numpy as np

from drivers.clock import Activity, Clock, Event
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.signals import ChannelDevice, Samples
from rig.channels.readings import Readings
from rig.channels.time_line import TimeLine
from rig.samples import TimedSamples
from rig.threads import DeviceThread, error_of_driver

_READ_S = 0.25
"""Longest wait in s for a sample, before the thread looks whether it is to end."""
_SILENCE_S, _SILENT_SAMPLES = 1.0, 10.0
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
    warn : callable
        Called with a sentence about lost samples, on the thread of the sampler.
    """

    def __init__(
        self,
        name: str,
        device: ChannelDevice,
        clock: Clock,
        record: Callable[[TimedSamples], None],
        warn: Callable[[str], None],
    ) -> None:
        super().__init__(f"samples of {name}")
        self._device_name, self._device, self._clock = name, device, clock
        self._record, self._warn = record, warn
        self._readings = Readings({signal.name: signal.delay_s for signal in device.signals})
        self.take = self._readings.take
        self._time_line = TimeLine(name)
        self._silence_s = max(_SILENCE_S, _SILENT_SAMPLES / device.rate_hz) if device.rate_hz else np.inf
        self._heard_s = clock.now_s()
        self._next: int | None = None
        self.lost = 0
        self._ending = threading.Event()
        self._first = Event()
        self._error: BaseException | None = None
        self._activity: Activity | None = None

    def begin(self) -> None:
        """Begin to read."""
        self._heard_s = self._clock.now_s()
        self._activity = self._clock.activity()
        self.start()

    def wait_for_first(self, timeout_s: float) -> None:
        """Wait until there is a sample. Raise the device's error, or `DeviceTimeout` after `timeout_s`."""
        if not self._clock.wait(self._first, timeout_s) and self._error is None:
            raise self._silence(timeout_s)
        self.check()

    def check(self) -> None:
        """Raise the error that ended the thread, and `DeviceTimeout` if the device has been silent."""
        if self._error is not None:
            raise self._error
        silent_s = self._clock.now_s() - self._heard_s
        if silent_s > self._silence_s + _READ_S:
            raise self._silence(silent_s)

    def stop(self) -> bool:
        """End the thread. Return False if the driver hangs."""
        self._ending.set()
        if self._activity is None:
            return True
        self._activity.end()
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
        finally:
            self._first.set()

    def _step(self) -> None:
        try:
            samples = self._device.read(_READ_S)
        except DeviceTimeout:
            # a slow device, or one without a fixed rate, may be silent for some time
            if self._clock.now_s() - self._heard_s > self._silence_s:
                raise
            return
        self._heard_s = self._clock.now_s()
        timed = self._timed(samples)
        self._count(samples)
        self._record(timed)
        self._require_valid(timed)
        self._readings.add(timed)
        self._first.set()

    def _timed(self, samples: Samples) -> TimedSamples:
        time_s, time_std_s = self._time_line.of(samples)
        device_s = np.full(len(time_s), np.nan) if samples.device_s is None else samples.device_s
        return TimedSamples(samples.values, time_s, time_std_s, device_s, samples.first)

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
            self.lost += lost
            self._warn(f"{self._device_name}: {lost} samples before sample {samples.first} were lost")
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
                    "no valid value" if np.isnan(value) else f"{value:.6g} {signal.unit}",
                    "check the sensor, its amplifier and its cable; if the value is right, widen the range "
                    f"of {signal.name} in the rig file",
                )

    def _silence(self, silent_s: float) -> DeviceTimeout:
        return DeviceTimeout(
            self._device_name,
            "read",
            f"a sample every {1.0 / self._device.rate_hz:g} s" if self._device.rate_hz else "a sample",
            f"none for {silent_s:.2g} s",
            "check the device and its cable",
        )
