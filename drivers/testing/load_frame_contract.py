"""The contract of load frames."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import LoadFrame
from drivers.testing.common import Counter, Handle, assert_identified, assert_says_all, needed, wait_until

ANSWER_S = 30.0


@dataclass(frozen=True)
class LoadFrameBench:
    """A newly opened load frame that holds at 0 N and 0 mm, with handles for the tests.

    Attributes
    ----------
    load_frame : LoadFrame
        With a specimen that reaches 2 kN within 1 mm; the limits of the machine must allow both.
    clock : Clock
        The clock the machine runs on.
    load_tolerance_n, displacement_tolerance_mm : float
        Largest distance of a stopped machine from its target.
    duration_tolerance : float
        Largest relative deviation of a motion's duration from the duration at the commanded rate.
    commands : callable, optional
        ``commands()`` returns the number of motion commands that the machine executed, without holds.
    lose_answers, restore : callable, optional
        Lose all answers of a machine that still executes commands; restore normal operation.
    break_load_cell, freeze : callable, optional
        Make the load NaN; freeze the readings and their counter.
    press_estop, release_estop : callable, optional
    """

    load_frame: LoadFrame
    clock: Clock
    load_tolerance_n: float = 2.0
    displacement_tolerance_mm: float = 1e-3
    duration_tolerance: float = 0.25
    commands: Counter | None = None
    lose_answers: Handle | None = None
    restore: Handle | None = None
    break_load_cell: Handle | None = None
    freeze: Handle | None = None
    press_estop: Handle | None = None
    release_estop: Handle | None = None

    def arrive(self) -> float:
        """Wait until the crosshead stands, and return the seconds it took."""
        start_s = self.clock.now_s()
        wait_until(lambda: not self.load_frame.read().moving, self.clock)
        return self.clock.now_s() - start_s


class LoadFrameContract:
    """Inherit from this class and define a fixture `bench`: a `LoadFrameBench`, closed at the end."""

    def test_tells_who_it_is(self, bench: LoadFrameBench) -> None:
        """The run file needs the identity."""
        assert_identified(bench.load_frame.info)

    def test_opening_moves_nothing(self, bench: LoadFrameBench) -> None:
        """Opening must not endanger a person at the rig."""
        state = bench.load_frame.read()
        assert not state.moving
        assert state.holding
        assert state.displacement_mm == pytest.approx(0.0, abs=bench.displacement_tolerance_mm)

    def test_goes_to_a_displacement(self, bench: LoadFrameBench) -> None:
        """0.2 mm at 0.1 mm/s takes the expected time, and the machine reports arrival."""
        bench.load_frame.go_to_displacement(0.2, 0.1)
        assert bench.load_frame.read().moving
        assert bench.arrive() == pytest.approx(2.0, rel=bench.duration_tolerance)
        state = bench.load_frame.read()
        assert state.at_target
        assert state.displacement_mm == pytest.approx(0.2, abs=bench.displacement_tolerance_mm)
        assert state.faults == ()

    def test_goes_to_a_load(self, bench: LoadFrameBench) -> None:
        """500 N at 250 N/s takes the expected time, and the machine reports arrival."""
        bench.load_frame.go_to_load(500.0, 250.0)
        assert bench.arrive() == pytest.approx(2.0, rel=bench.duration_tolerance)
        state = bench.load_frame.read()
        assert state.at_target
        assert state.load_n == pytest.approx(500.0, abs=bench.load_tolerance_n)

    def test_tare_makes_the_present_state_the_zero(self, bench: LoadFrameBench) -> None:
        """Both load and displacement become zero."""
        bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.arrive()
        bench.load_frame.tare()
        state = bench.load_frame.read()
        assert state.load_n == pytest.approx(0.0, abs=bench.load_tolerance_n)
        assert state.displacement_mm == pytest.approx(0.0, abs=bench.displacement_tolerance_mm)

    def test_refuses_what_is_beyond_its_limits_before_anything_moves(self, bench: LoadFrameBench) -> None:
        """Targets beyond the limits are refused, not clipped."""
        limits = bench.load_frame.limits
        for load_n in (limits.load_min_n - 1.0, limits.load_max_n + 1.0, math.nan):
            with pytest.raises(DeviceFault) as refused:
                bench.load_frame.go_to_load(load_n, 100.0)
            assert_says_all(refused.value)
        for displacement_mm in (limits.displacement_min_mm - 0.1, limits.displacement_max_mm + 0.1, math.inf):
            with pytest.raises(DeviceFault):
                bench.load_frame.go_to_displacement(displacement_mm, 0.1)
        for speed_mm_s in (0.0, -0.1, limits.speed_max_mm_s * 1.01, math.nan):
            with pytest.raises(DeviceFault):
                bench.load_frame.go_to_displacement(0.1, speed_mm_s)
        assert not bench.load_frame.read().moving

    def test_hold_returns_when_it_stands(self, bench: LoadFrameBench) -> None:
        """Another motion may follow."""
        bench.load_frame.go_to_displacement(1.0, 0.1)
        bench.clock.sleep(1.0)
        bench.load_frame.hold()
        state = bench.load_frame.read()
        assert state.holding
        assert not state.moving
        assert 0.0 < state.displacement_mm < 0.5
        bench.load_frame.hold()
        bench.load_frame.go_to_displacement(0.0, 1.0)
        bench.arrive()
        assert bench.load_frame.read().at_target

    def test_readings_are_new(self, bench: LoadFrameBench) -> None:
        """The machine's sample counter increases."""
        first = bench.load_frame.read()
        bench.clock.sleep(0.5)
        second = bench.load_frame.read()
        assert second.sample > first.sample
        assert second.time_s > first.time_s

    def test_readings_that_stand_still_are_refused(self, bench: LoadFrameBench) -> None:
        """Frozen readings look like a holding machine; no motion may start from them."""
        freeze = needed(bench.freeze, "freeze the readings")
        bench.load_frame.read()
        freeze()
        bench.load_frame.read()
        bench.clock.sleep(10.0)
        commands = bench.commands or (lambda: 0)
        count = commands()
        with pytest.raises(DeviceFault) as stale:
            bench.load_frame.read()
        assert_says_all(stale.value)
        with pytest.raises(DeviceFault):
            bench.load_frame.go_to_displacement(0.1, 0.1)
        assert commands() == count

    def test_a_load_that_is_none_is_refused_but_the_machine_holds(self, bench: LoadFrameBench) -> None:
        """A broken wire must neither count as a load nor prevent a stop."""
        break_load_cell = needed(bench.break_load_cell, "break the load cell")
        bench.load_frame.go_to_displacement(1.0, 0.1)
        break_load_cell()
        bench.clock.sleep(0.1)
        with pytest.raises(DeviceFault) as broken:
            bench.load_frame.read()
        assert_says_all(broken.value)
        bench.load_frame.hold()

    def test_without_a_load_that_is_one_nothing_is_set_in_motion(self, bench: LoadFrameBench) -> None:
        """The driver checks the load before the command; a later check would find the crosshead moving."""
        break_load_cell = needed(bench.break_load_cell, "break the load cell")
        commands = needed(bench.commands, "count commands")
        break_load_cell()
        count = commands()
        with pytest.raises(DeviceFault):
            bench.load_frame.go_to_displacement(0.1, 0.1)
        assert commands() == count

    def test_an_open_emergency_stop_is_told_and_takes_no_motion(self, bench: LoadFrameBench) -> None:
        """The driver reads the emergency stop but never resets it."""
        press, release = needed(bench.press_estop, "press"), needed(bench.release_estop, "release")
        press()
        assert bench.load_frame.read().faults
        with pytest.raises(DeviceFault) as refused:
            bench.load_frame.go_to_displacement(0.1, 0.1)
        assert_says_all(refused.value)
        release()
        bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.arrive()
        assert bench.load_frame.read().at_target

    def test_silence_is_told_in_time_and_motion_waits_for_a_hold(self, bench: LoadFrameBench) -> None:
        """Calls do not hang. The state of the machine is unknown until a hold is confirmed."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        with ThreadPoolExecutor(1) as pool, pytest.raises(DeviceTimeout) as silence:
            pool.submit(bench.load_frame.read).result(ANSWER_S)
        assert_says_all(silence.value)
        restore()
        bench.load_frame.read()
        with pytest.raises(DeviceFault):
            bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.load_frame.hold()
        bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.arrive()
        assert bench.load_frame.read().at_target

    def test_a_command_whose_answer_is_lost_is_executed_once_at_most(self, bench: LoadFrameBench) -> None:
        """Some machines would move twice the distance after a repeated command."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        commands = needed(bench.commands, "count commands")
        count = commands()
        lose()
        with pytest.raises(DeviceTimeout):
            bench.load_frame.go_to_displacement(0.1, 0.1)
        restore()
        assert commands() in (count, count + 1)
        bench.load_frame.hold()

    def test_closing_twice_is_harmless_and_the_end(self, bench: LoadFrameBench) -> None:
        """Calls on a closed device fail at once."""
        bench.load_frame.close()
        bench.load_frame.close()
        with pytest.raises(LinkLost) as lost:
            bench.load_frame.read()
        assert_says_all(lost.value)
