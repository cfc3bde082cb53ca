"""Tests that every driver of a channel device must pass."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.clock import Clock, VirtualClock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.signals import ChannelDevice, Samples
from drivers.testing.common import Counter, Handle, assert_error_in_time, assert_says_all, needed

ANSWER_S = 5.0
_READINGS = 200


@dataclass(frozen=True)
class ChannelsBench:
    """A newly opened channel device, with functions that change its inputs and cause faults.

    Attributes
    ----------
    device : ChannelDevice
    clock : Clock
        The clock of the run.
    true : mapping of str to float
        The present true value of each signal, in its unit.
    tolerance : float
        Largest difference between a value and the true value.
    show : callable, optional
        ``show(name, value)`` sets the true value of a signal, within its range.
    changes : callable, optional
        ``changes()`` returns the number of requests that changed something in the device.
    lose_answers, restore : callable, optional
        ``lose_answers()`` loses all answers, or all samples, of the device. ``restore()`` restores normal
        operation after every fault.
    unplug : callable, optional
        ``unplug()`` disconnects the device.
    break_sensor : callable, optional
        ``break_sensor()`` makes the device report that it has no valid value.
    skip_samples : callable, optional
        ``skip_samples()`` loses some samples of a device that counts them.
    sends_by_itself : bool
        True for a device without a clock that sends samples without being asked. Samples may then wait until
        they are read, and each is younger than the sample before.
    """

    device: ChannelDevice
    clock: Clock
    true: Mapping[str, float]
    tolerance: float
    show: Callable[[str, float], object] | None = None
    changes: Counter | None = None
    lose_answers: Handle | None = None
    restore: Handle | None = None
    unplug: Handle | None = None
    break_sensor: Handle | None = None
    skip_samples: Handle | None = None
    sends_by_itself: bool = False

    def newest(self) -> dict[str, float]:
        """Return the newest value of each signal."""
        values = self.device.read(ANSWER_S).values[-1]
        return {signal.name: float(value) for signal, value in zip(self.device.signals, values, strict=True)}

    def assert_shows(self, true: Mapping[str, float]) -> None:
        """Check that the values become the true ones."""
        for _ in range(_READINGS):
            found = self.newest()
            if all(abs(found[name] - value) <= self.tolerance for name, value in true.items()):
                return
        assert found == pytest.approx(dict(true), rel=0.0, abs=self.tolerance)


def assert_samples(device: ChannelDevice, samples: Samples) -> None:
    """Check shape, kind and times of samples."""
    assert samples.values.dtype == np.float64
    assert samples.values.ndim == 2
    assert len(samples.values) >= 1
    assert samples.values.shape[1] == len(device.signals)
    assert math.isfinite(samples.received_s)
    assert samples.asked_s <= samples.received_s
    if samples.device_s is not None:
        assert samples.device_s.shape == (len(samples.values),)
        assert (np.diff(samples.device_s) > 0.0).all()
    else:
        # without a clock of the device, only the call tells when a sample was taken
        assert len(samples.values) == 1


class ChannelsContract:
    """Tests of a channel device: inherit from this class and define a fixture `bench`.

    The fixture yields a `ChannelsBench`, and closes the device after the test.
    """

    def test_tells_what_it_is(self, bench: ChannelsBench) -> None:
        """Vendor, model, names, units and ranges are needed for the run file."""
        device = bench.device
        assert device.info.vendor
        assert device.info.model
        assert len({signal.name for signal in device.signals}) == len(device.signals) > 0
        assert set(bench.true) == {signal.name for signal in device.signals}
        assert math.isfinite(device.rate_hz)
        assert device.rate_hz >= 0.0
        for signal in device.signals:
            assert signal.unit.isprintable()
            assert signal.low < signal.high

    def test_reads_the_true_values(self, bench: ChannelsBench) -> None:
        """Each signal must have its own true value, in its unit."""
        assert_samples(bench.device, bench.device.read(ANSWER_S))
        bench.assert_shows(bench.true)

    def test_a_change_of_one_signal_is_seen_in_this_signal_only(self, bench: ChannelsBench) -> None:
        """No stored value may be returned, and no signal may be taken for another."""
        show, true = needed(bench.show, "change a value"), dict(bench.true)
        for signal in bench.device.signals:
            true[signal.name] = signal.low + 0.75 * (signal.high - signal.low)
            show(signal.name, true[signal.name])
            bench.assert_shows(true)

    def test_samples_are_numbered_and_in_time(self, bench: ChannelsBench) -> None:
        """No sample may be missing or returned twice, and none may be older than the one before."""
        device, clock = bench.device, bench.clock
        before = device.read(ANSWER_S)
        for _ in range(20):
            begun_s = clock.now_s()
            now = device.read(ANSWER_S)
            assert_samples(device, now)
            assert now.first == before.first + len(before.values)
            assert before.received_s <= now.received_s <= clock.now_s()
            if now.device_s is not None:
                assert before.device_s is not None
                assert now.device_s[0] > before.device_s[-1]
            elif bench.sends_by_itself:
                assert before.asked_s <= now.asked_s < math.inf
            else:
                assert before.received_s <= now.asked_s
                assert now.received_s >= begun_s
            before = now

    def test_the_rate_is_as_told(self, bench: ChannelsBench) -> None:
        """Samples must come as often as the device says, on the clock of the rig or its own."""
        device = bench.device
        if device.rate_hz == 0.0:
            pytest.skip("this device has no fixed rate")
        first = device.read(ANSWER_S)
        if bench.sends_by_itself and first.device_s is None:
            pytest.skip("only the arrival tells the times of these samples, which depends on the computer")
        last, count = first, 0
        while count < 20:
            last = device.read(ANSWER_S)
            count += len(last.values)
        begun_s, ended_s = (
            (first.device_s[-1], last.device_s[-1])
            if first.device_s is not None and last.device_s is not None
            else (first.asked_s, last.asked_s)
        )
        found_hz = count / (ended_s - begun_s)
        assert found_hz <= 1.2 * device.rate_hz
        # In real time a busy computer may be late, but never early.
        assert found_hz >= 0.8 * device.rate_hz or not isinstance(bench.clock, VirtualClock)

    def test_lost_samples_are_counted(self, bench: ChannelsBench) -> None:
        """Samples that were lost must leave a gap in the numbers."""
        skip = needed(bench.skip_samples, "lose samples")
        before = bench.device.read(ANSWER_S)
        skip()
        for _ in range(_READINGS):
            now = bench.device.read(ANSWER_S)
            if now.first > before.first + len(before.values):
                return
            before = now
        pytest.fail("the lost samples were not seen")

    def test_reading_changes_nothing(self, bench: ChannelsBench) -> None:
        """The driver must only read, because its device may also command a machine."""
        changes = needed(bench.changes, "count changes")
        before = changes()
        bench.device.read(ANSWER_S)
        bench.device.read(ANSWER_S)
        assert changes() == before

    def test_silence_is_told_in_time_and_overcome(self, bench: ChannelsBench) -> None:
        """Without an answer, `read` must raise an error in time. Later it must work without a new opening."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        bench.device.read(ANSWER_S)
        lose()
        assert_error_in_time(lambda: [bench.device.read(0.5) for _ in range(_READINGS)], DeviceTimeout)
        restore()
        bench.assert_shows(bench.true)

    def test_a_device_that_is_gone_gives_an_error(self, bench: ChannelsBench) -> None:
        """If the cable is unplugged, `read` must raise an error; when it is back, `read` must work."""
        unplug, restore = needed(bench.unplug, "unplug"), needed(bench.restore, "restore")
        unplug()
        assert_error_in_time(lambda: [bench.device.read(0.5) for _ in range(_READINGS)], DeviceError)
        restore()
        bench.assert_shows(bench.true)

    def test_a_value_that_is_none_is_no_number(self, bench: ChannelsBench) -> None:
        """If the device has no valid value, the value must be NaN, or `read` must raise an error."""
        needed(bench.break_sensor, "break the sensor")()
        try:
            for _ in range(_READINGS):
                if np.isnan(bench.device.read(ANSWER_S).values).any():
                    return
        except DeviceError as broken:
            assert_says_all(broken)
            return
        pytest.fail("a broken sensor was not seen")

    def test_closing_twice_is_harmless_and_the_end(self, bench: ChannelsBench) -> None:
        """Calls on a closed device must raise `LinkLost`."""
        bench.device.close()
        bench.device.close()
        with pytest.raises(LinkLost) as lost:
            bench.device.read(ANSWER_S)
        assert_says_all(lost.value)
