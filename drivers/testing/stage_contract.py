"""Tests that every rotation stage driver must pass."""

import math
from dataclasses import dataclass

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import RotationStage
from drivers.testing.common import (
    Counter,
    Handle,
    assert_error_in_time,
    assert_identified,
    assert_says_all,
    assert_settings,
    needed,
    wait_until,
)


@dataclass(frozen=True)
class StageBench:
    """A newly opened stage that stands still without a reference position, and functions that cause faults.

    Attributes
    ----------
    stage : RotationStage
    clock : Clock
        The clock of the stage's motion.
    angle_min_deg, angle_max_deg : float
        Limits of the stage in degrees. The limits must allow a move from 0° to 40°.
    tolerance_deg : float
        Largest distance of a stopped stage from its target, in degrees.
    speed_deg_s : float, optional
        Speed in the settings of the stage, in degrees per second.
    motions : callable, optional
        ``motions()`` returns the number of motion commands that reached the device.
    lose_answers : callable, optional
        ``lose_answers()`` loses all answers of the device, which still executes commands.
    restore : callable, optional
        ``restore()`` restores normal operation after ``lose_answers()``.
    power_cycle : callable, optional
        ``power_cycle()`` switches the device off and on.
    """

    stage: RotationStage
    clock: Clock
    angle_min_deg: float
    angle_max_deg: float
    tolerance_deg: float = 0.01
    speed_deg_s: float | None = None
    motions: Counter | None = None
    lose_answers: Handle | None = None
    restore: Handle | None = None
    power_cycle: Handle | None = None

    def arrive(self) -> float:
        """Wait until the stage has stopped, and return its angle."""
        wait_until(lambda: not self.stage.read().moving, self.clock)
        return self.stage.read().angle_deg

    def home(self) -> None:
        """Search for the reference position, and wait for the end of the search."""
        self.stage.home()
        self.arrive()


class StageContract:
    """Tests of a stage: inherit from this class and define a fixture `bench`.

    The fixture yields a `StageBench`, and closes the stage after the test.
    """

    def test_tells_who_it_is(self, bench: StageBench) -> None:
        """The stage must report its identity, because the run file contains the identity."""
        assert_identified(bench.stage.info)

    def test_settings_are_read_back_without_a_motion(self, bench: StageBench) -> None:
        """A stage that offers settings must report its limits and its speed in degrees."""
        read = needed(getattr(bench.stage, "read_settings", None), "read settings")
        motions = needed(bench.motions, "count motions")
        found = assert_settings(read)
        assert found["angle_min_deg"] == pytest.approx(bench.angle_min_deg, abs=bench.tolerance_deg)
        assert found["angle_max_deg"] == pytest.approx(bench.angle_max_deg, abs=bench.tolerance_deg)
        if bench.speed_deg_s is not None:
            assert found["speed_deg_s"] == pytest.approx(bench.speed_deg_s, rel=1e-3)
        assert motions() == 0

    def test_settings_that_cannot_be_read_are_an_error_in_time(self, bench: StageBench) -> None:
        """If the stage does not answer, the driver must raise an error instead of reporting settings."""
        read = needed(getattr(bench.stage, "read_settings", None), "read settings")
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        assert_error_in_time(read, DeviceTimeout)
        restore()

    def test_opening_moves_nothing(self, bench: StageBench) -> None:
        """Opening must not start a motion, because a motion could injure a person at the rig."""
        motions = needed(bench.motions, "count motions")
        assert not bench.stage.read().moving
        assert motions() == 0

    def test_takes_no_move_without_a_reference(self, bench: StageBench) -> None:
        """Before a home search, `move_to` must be refused, because the stage does not know its angle yet."""
        assert not bench.stage.read().homed
        with pytest.raises(DeviceFault) as refused:
            bench.stage.move_to(0.0)
        assert_says_all(refused.value)
        assert not bench.stage.read().moving

    def test_homes_and_moves_to_an_angle(self, bench: StageBench) -> None:
        """After a home search, the stage must have a reference and reach two angles."""
        bench.home()
        assert bench.stage.read().homed
        bench.stage.move_to(30.0)
        assert bench.arrive() == pytest.approx(30.0, abs=bench.tolerance_deg)
        bench.stage.move_to(17.5)
        assert bench.arrive() == pytest.approx(17.5, abs=bench.tolerance_deg)

    def test_a_reading_has_the_time_it_was_made_at(self, bench: StageBench) -> None:
        """Each `read` must return a new reading with the time of the call, not an earlier state."""
        bench.clock.sleep(3.0)
        before_s = bench.clock.now_s()
        assert before_s <= bench.stage.read().time_s <= bench.clock.now_s()

    def test_refuses_what_is_out_of_its_limits_before_anything_moves(self, bench: StageBench) -> None:
        """Angles beyond the limits must be refused, not reduced to the limit."""
        bench.home()
        for angle_deg in (bench.angle_min_deg - 0.1, bench.angle_max_deg + 0.1, math.nan, math.inf):
            with pytest.raises(DeviceFault) as refused:
                bench.stage.move_to(angle_deg)
            assert_says_all(refused.value)
        assert not bench.stage.read().moving
        for angle_deg in (bench.angle_min_deg, bench.angle_max_deg):
            bench.stage.move_to(angle_deg)
            assert bench.arrive() == pytest.approx(angle_deg, abs=bench.tolerance_deg)

    def test_moves_at_the_speed_of_its_settings(self, bench: StageBench) -> None:
        """A move by 40° must take 40° divided by the set speed; acceleration may add at most a quarter to
        this time."""
        duration_s = 40.0 / needed(bench.speed_deg_s, "tell its speed")
        bench.home()
        start_s = bench.clock.now_s()
        bench.stage.move_to(40.0)
        bench.arrive()
        assert duration_s <= bench.clock.now_s() - start_s < 1.25 * duration_s

    def test_refuses_a_second_motion(self, bench: StageBench) -> None:
        """During a motion, a second motion must be refused, and the first motion must continue."""
        bench.home()
        bench.stage.move_to(40.0)
        with pytest.raises(DeviceFault):
            bench.stage.move_to(0.0)
        assert bench.arrive() == pytest.approx(40.0, abs=bench.tolerance_deg)

    def test_stop_returns_when_it_stands(self, bench: StageBench) -> None:
        """After `stop` returns, the stage must stand still and accept another motion."""
        bench.home()
        bench.stage.move_to(40.0)
        bench.clock.sleep(0.5)
        bench.stage.stop()
        state = bench.stage.read()
        assert not state.moving
        assert 0.0 < state.angle_deg < 39.0
        bench.stage.stop()
        bench.stage.move_to(0.0)
        assert bench.arrive() == pytest.approx(0.0, abs=bench.tolerance_deg)

    def test_a_stopped_home_search_found_nothing(self, bench: StageBench) -> None:
        """If a home search is stopped, the stage must not count as homed."""
        bench.stage.home()
        bench.stage.stop()
        assert not bench.stage.read().homed

    def test_silence_is_told_in_time_and_overcome(self, bench: StageBench) -> None:
        """If the stage does not answer, calls must end in time; later the stage must work again without being
        reopened."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        assert_error_in_time(bench.stage.read, DeviceTimeout)
        restore()
        assert not bench.stage.read().moving

    def test_a_move_whose_answer_is_lost_is_done_once(self, bench: StageBench) -> None:
        """If the answer to a motion command is lost, the driver must not send the command again."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        motions = needed(bench.motions, "count motions")
        bench.home()
        count = motions()
        lose()
        with pytest.raises(DeviceError):
            bench.stage.move_to(40.0)
        restore()
        assert motions() in (count, count + 1)

    def test_a_lost_reference_is_noticed(self, bench: StageBench) -> None:
        """After a power cut, motion must be refused until a home search, because the angle is unknown."""
        power_cycle = needed(bench.power_cycle, "switch the device off and on")
        bench.home()
        bench.stage.move_to(20.0)
        bench.arrive()
        power_cycle()
        with pytest.raises(DeviceFault) as refused:
            bench.stage.move_to(0.0)
        assert_says_all(refused.value)
        bench.home()
        bench.stage.move_to(10.0)
        assert bench.arrive() == pytest.approx(10.0, abs=bench.tolerance_deg)

    def test_closing_twice_is_harmless_and_the_end(self, bench: StageBench) -> None:
        """Calls on a closed stage must raise `LinkLost`."""
        bench.stage.close()
        bench.stage.close()
        with pytest.raises(LinkLost) as lost:
            bench.stage.read()
        assert_says_all(lost.value)
