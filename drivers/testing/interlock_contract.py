"""Tests that every interlock driver must pass."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import Interlock
from drivers.testing.common import Counter, Handle, assert_error_in_time, assert_says_all, needed


@dataclass(frozen=True)
class InterlockBench:
    """A newly opened interlock, with functions that change its value and cause faults.

    Attributes
    ----------
    interlock : Interlock
    clock : Clock
        The clock of the run, on which `time_s` of a reading is measured.
    values : tuple of float
        Two or more different values, of which the first is the present value. A contact has the values 1
        (closed) and 0 (open).
    tolerance : float
        Largest difference between a reading and the true value.
    show : callable, optional
        ``show(value)`` sets the true value to one of `values`.
    changes : callable, optional
        ``changes()`` returns the number of requests that changed something in the device.
    lose_answers, restore : callable, optional
        ``lose_answers()`` loses all answers of the device. ``restore()`` restores normal operation after
        ``lose_answers()`` and after ``unplug()``.
    unplug : callable, optional
        ``unplug()`` disconnects the device.
    break_sensor : callable, optional
        ``break_sensor()`` makes the device report that it has no valid value.
    """

    interlock: Interlock
    clock: Clock
    values: tuple[float, ...]
    tolerance: float = 0.0
    show: Callable[[float], object] | None = None
    changes: Counter | None = None
    lose_answers: Handle | None = None
    restore: Handle | None = None
    unplug: Handle | None = None
    break_sensor: Handle | None = None

    def assert_shows(self, value: float) -> None:
        """Check that a reading has the true value."""
        assert self.interlock.read().value == pytest.approx(value, rel=0.0, abs=self.tolerance)


class InterlockContract:
    """Tests of an interlock: inherit from this class and define a fixture `bench`.

    The fixture yields an `InterlockBench`, and closes the interlock after the test.
    """

    def test_tells_what_it_is(self, bench: InterlockBench) -> None:
        """The interlock must report vendor and model for the run file. A contact has no serial number."""
        assert bench.interlock.info.vendor
        assert bench.interlock.info.model
        assert bench.interlock.unit == bench.interlock.unit.strip()
        assert bench.interlock.unit.isprintable()

    def test_reads_the_true_value(self, bench: InterlockBench) -> None:
        """A reading must have the true value as a finite number."""
        assert math.isfinite(bench.interlock.read().value)
        bench.assert_shows(bench.values[0])

    def test_each_reading_is_new(self, bench: InterlockBench) -> None:
        """The reading after a change must have the new value. A driver must not return a stored value."""
        show = needed(bench.show, "change the value")
        assert len(set(bench.values)) > 1
        for value in (*bench.values[1:], *bench.values):
            show(value)
            bench.assert_shows(value)

    def test_a_reading_has_the_time_it_was_made_at(self, bench: InterlockBench) -> None:
        """The time of a reading must be between the beginning and the end of the call."""
        bench.clock.sleep(3.0)
        before_s = bench.clock.now_s()
        assert before_s <= bench.interlock.read().time_s <= bench.clock.now_s()

    def test_opening_and_reading_change_nothing(self, bench: InterlockBench) -> None:
        """The driver of an interlock must only read, because its device may also switch machines."""
        changes = needed(bench.changes, "count changes")
        bench.interlock.read()
        bench.interlock.read()
        assert changes() == 0

    def test_silence_is_told_in_time_and_overcome(self, bench: InterlockBench) -> None:
        """If the device does not answer, `read` must raise an error in time and return no earlier value.
        Later `read` must work again, without a new opening."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        bench.interlock.read()
        lose()
        assert_error_in_time(bench.interlock.read, DeviceTimeout)
        restore()
        bench.assert_shows(bench.values[0])

    def test_a_change_during_a_silence_is_read_afterwards(self, bench: InterlockBench) -> None:
        """When the device answers again after a silence, a late answer must not count as a new reading."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        show = needed(bench.show, "change the value")
        lose()
        with pytest.raises(DeviceError):
            bench.interlock.read()
        show(bench.values[-1])
        restore()
        bench.assert_shows(bench.values[-1])

    def test_a_device_that_is_gone_gives_an_error_and_no_value(self, bench: InterlockBench) -> None:
        """If the cable is unplugged, `read` must raise an error; when the cable is back, `read` must work."""
        unplug, restore = needed(bench.unplug, "unplug"), needed(bench.restore, "restore")
        unplug()
        assert_error_in_time(bench.interlock.read, DeviceError)
        restore()
        bench.assert_shows(bench.values[0])

    def test_a_value_that_is_none_is_refused(self, bench: InterlockBench) -> None:
        """If the device has no valid value, `read` must raise an error instead of returning a number."""
        needed(bench.break_sensor, "break the sensor")()
        with pytest.raises(DeviceError) as broken:
            bench.interlock.read()
        assert_says_all(broken.value)

    def test_closing_twice_is_harmless_and_the_end(self, bench: InterlockBench) -> None:
        """Calls on a closed interlock must raise `LinkLost`."""
        bench.interlock.close()
        bench.interlock.close()
        with pytest.raises(LinkLost) as lost:
            bench.interlock.read()
        assert_says_all(lost.value)
