"""The contract of rotation stages."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import RotationStage
from drivers.testing.common import Counter, Handle, assert_identified, assert_says_all, needed, wait_until

ANSWER_S = 30.0


@dataclass(frozen=True)
class StageBench:
    """A stage that was just opened and stands without a reference, and what can be done to it.

    Attributes
    ----------
    stage : RotationStage
    clock : Clock
        The clock its motion runs on.
    angle_min_deg, angle_max_deg : float
        Its limits; they must leave room for a way of 40° from 0.
    tolerance_deg : float
        How near a standing stage is to its target.
    speed_deg_s : float, optional
        The speed that its settings give.
    motions : callable, optional
        ``motions()`` counts the motion commands that reached the device.
    lose_answers : callable, optional
        From now on the device acts, but its answers are lost.
    restore : callable, optional
        Everything is as it should be again.
    power_cycle : callable, optional
        Switch the device off and on.
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
        """Wait until the stage stands and return its angle."""
        wait_until(lambda: not self.stage.read().moving, self.clock)
        return self.stage.read().angle_deg

    def home(self) -> None:
        """Find the reference position."""
        self.stage.home()
        self.arrive()


class StageContract:
    """Inherit from it and give a fixture `bench`: a `StageBench`, closed at its end."""

    def test_tells_who_it_is(self, bench: StageBench) -> None:
        """The run file needs it."""
        assert_identified(bench.stage.info)

    def test_opening_moves_nothing(self, bench: StageBench) -> None:
        """Whoever stands at the rig is not surprised."""
        motions = needed(bench.motions, "count motions")
        assert not bench.stage.read().moving
        assert motions() == 0

    def test_takes_no_move_without_a_reference(self, bench: StageBench) -> None:
        """An angle without a reference means nothing."""
        assert not bench.stage.read().homed
        with pytest.raises(DeviceFault) as refused:
            bench.stage.move_to(0.0)
        assert_says_all(refused.value)
        assert not bench.stage.read().moving

    def test_homes_and_moves_to_an_angle(self, bench: StageBench) -> None:
        """What it is for."""
        bench.home()
        assert bench.stage.read().homed
        bench.stage.move_to(30.0)
        assert bench.arrive() == pytest.approx(30.0, abs=bench.tolerance_deg)
        bench.stage.move_to(17.5)
        assert bench.arrive() == pytest.approx(17.5, abs=bench.tolerance_deg)

    def test_a_reading_has_the_time_it_was_made_at(self, bench: StageBench) -> None:
        """A state is never an old one."""
        bench.clock.sleep(3.0)
        before_s = bench.clock.now_s()
        assert before_s <= bench.stage.read().time_s <= bench.clock.now_s()

    def test_refuses_what_is_out_of_its_limits_before_anything_moves(self, bench: StageBench) -> None:
        """Refused, not clipped."""
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
        """It takes at most a quarter longer, for it has to accelerate."""
        duration_s = 40.0 / needed(bench.speed_deg_s, "tell its speed")
        bench.home()
        start_s = bench.clock.now_s()
        bench.stage.move_to(40.0)
        bench.arrive()
        assert duration_s <= bench.clock.now_s() - start_s < 1.25 * duration_s

    def test_refuses_a_second_motion(self, bench: StageBench) -> None:
        """Whoever wants it stops the first one."""
        bench.home()
        bench.stage.move_to(40.0)
        with pytest.raises(DeviceFault):
            bench.stage.move_to(0.0)
        assert bench.arrive() == pytest.approx(40.0, abs=bench.tolerance_deg)

    def test_stop_returns_when_it_stands(self, bench: StageBench) -> None:
        """And it may move again afterwards."""
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
        """A stage that stands still is not a stage at its reference."""
        bench.stage.home()
        bench.stage.stop()
        assert not bench.stage.read().homed

    def test_silence_is_told_in_time_and_overcome(self, bench: StageBench) -> None:
        """No hang, and no reopening needed where nothing was lost but answers."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        with ThreadPoolExecutor(1) as pool, pytest.raises(DeviceTimeout) as silence:
            pool.submit(bench.stage.read).result(ANSWER_S)
        assert_says_all(silence.value)
        restore()
        assert not bench.stage.read().moving

    def test_a_move_whose_answer_is_lost_is_done_once(self, bench: StageBench) -> None:
        """The stage is asked what it does instead."""
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
        """After a power cut the counter says something, but not where the stage is."""
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
        """A closed device answers at once."""
        bench.stage.close()
        bench.stage.close()
        with pytest.raises(LinkLost) as lost:
            bench.stage.read()
        assert_says_all(lost.value)
