"""All measured channels of one run: their samplers, their record, and the load that is only read."""

from collections.abc import Callable, Mapping

from drivers.clock import Clock
from drivers.signals import ChannelDevice
from rig.channels.sampler import Sampler
from rig.samples import SignalReading, TimedSamples

FIRST_S = 5.0
"""Longest wait in s for the first sample of a device."""


class RunChannels:
    """The channel devices of a run, by their names in the rig file.

    `record` is called with a device's name and its samples, and `warn` with a sentence about lost samples,
    both on the thread of the device's sampler.
    """

    def __init__(
        self,
        devices: Mapping[str, ChannelDevice],
        clock: Clock,
        record: Callable[[str, TimedSamples], None] = lambda _, __: None,
        warn: Callable[[str], None] = lambda _: None,
    ) -> None:
        def recording(name: str) -> Callable[[TimedSamples], None]:
            return lambda samples: record(name, samples)

        self._samplers = {
            name: Sampler(f"channels.{name}", device, clock, recording(name), warn)
            for name, device in devices.items()
        }

    def begin(self) -> None:
        """Begin to read all devices, and wait until each of them has given a sample.

        Raise `DeviceError` if a device fails.
        """
        for sampler in self._samplers.values():
            sampler.begin()
        for sampler in self._samplers.values():
            sampler.wait_for_first(FIRST_S)

    def read(self) -> dict[str, SignalReading]:
        """Return what all signals did since the last reading. Raise `DeviceError` if a device has failed."""
        found: dict[str, SignalReading] = {}
        for sampler in self._samplers.values():
            sampler.check()
            found |= sampler.take()
        return found

    def end(self) -> list[str]:
        """End all samplers. Return one sentence for each device whose driver hangs."""
        hanging = [name for name, sampler in self._samplers.items() if not sampler.stop()]
        return [f"channels.{name}: its driver hangs in read" for name in hanging]
