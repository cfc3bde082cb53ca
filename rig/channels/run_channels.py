"""All measured channels of one run: their samplers, their record, and the load that is only read."""

from collections.abc import Callable, Mapping

from drivers.clock import Clock
from drivers.signals import ChannelDevice
from rig.channels.sampler import HANG_S, Sampler
from rig.samples import SignalReading, TimedSamples


class RunChannels:
    """The channel devices of a run, by their names in the rig file.

    `record` is called with a device's name and its samples, on the thread of the device's sampler.
    `hang_s` is the time in s after which a call of a driver counts as hanging. With `any_value`, a value out
    of its range is no fault.
    """

    def __init__(
        self,
        devices: Mapping[str, ChannelDevice],
        clock: Clock,
        record: Callable[[str, TimedSamples], None] = lambda _, __: None,
        hang_s: float = HANG_S,
        any_value: bool = False,
    ) -> None:
        def recording(name: str) -> Callable[[TimedSamples], None]:
            return lambda samples: record(name, samples)

        self._samplers = {
            name: Sampler(f"channels.{name}", device, clock, recording(name), hang_s, any_value)
            for name, device in devices.items()
        }

    def begin(self) -> None:
        """Begin to read all devices."""
        for sampler in self._samplers.values():
            sampler.begin()

    @property
    def are_ready(self) -> bool:
        """True if each device has given a sample. Raise `DeviceError` if one fails or stays silent."""
        return all(sampler.is_ready for sampler in self._samplers.values())

    def read(self) -> dict[str, SignalReading]:
        """Return what all signals did since the last reading. Raise `DeviceError` if a device has failed."""
        found: dict[str, SignalReading] = {}
        for sampler in self._samplers.values():
            sampler.check()
            found |= sampler.take()
        return found

    def have_passed(self, time_s: float) -> bool:
        """Return whether the samples of all devices with a fixed rate reach a time on the rig's clock."""
        return all(sampler.has_passed(time_s) for sampler in self._samplers.values())

    def new_losses(self, *, whole: bool = False) -> list[str]:
        """Return sentences about samples that were lost and not told yet, not too often without `whole`."""
        told = [sampler.new_losses(whole=whole) for sampler in self._samplers.values()]
        return [sentence for sentence in told if sentence]

    @property
    def counts(self) -> dict[str, tuple[int, int]]:
        """For each device the number of its samples, and of the lost ones between them."""
        return {name: (sampler.count, sampler.lost) for name, sampler in self._samplers.items()}

    def end(self) -> dict[str, str]:
        """End all samplers. For each device whose driver hangs, return the call in which it does."""
        for sampler in self._samplers.values():
            sampler.ask_to_stop()
        hanging = [name for name, sampler in self._samplers.items() if not sampler.stop()]
        return {f"channels.{name}": "read, which has not returned at the end of the run" for name in hanging}
