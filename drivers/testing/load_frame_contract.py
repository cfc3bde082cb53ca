"""Tests that every load frame driver must pass."""

import math
from dataclasses import asdict

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.testing.common import (
    assert_error_in_time,
    assert_identified,
    assert_says_all,
    assert_settings,
    needed,
)
from drivers.testing.load_frame_bench import LoadFrameBench
from drivers.testing.speed_contract import SpeedContract


class LoadFrameContract(SpeedContract):
    """Tests of a load frame: inherit from this class and define a fixture `bench`.

    The fixture yields a `LoadFrameBench`, and closes the load frame after the test.
    """

    def test_tells_who_it_is(self, bench: LoadFrameBench) -> None:
        """The load frame must report its identity, because the run file contains the identity."""
        assert_identified(bench.load_frame.info)

    def test_settings_are_read_back_without_a_motion(self, bench: LoadFrameBench) -> None:
        """A load frame that offers settings must report its limits in the units of the rig file."""
        read = needed(getattr(bench.load_frame, "read_settings", None), "read settings")
        commands = bench.commands or (lambda: 0)
        count = commands()
        found = assert_settings(read)
        for name, limit in asdict(bench.load_frame.limits).items():
            assert found[name] == pytest.approx(limit, rel=1e-3)
        assert commands() == count
        assert not bench.load_frame.read().moving

    def test_settings_that_cannot_be_read_are_an_error_in_time(self, bench: LoadFrameBench) -> None:
        """If the machine does not answer, the driver must raise an error instead of reporting settings."""
        read = needed(getattr(bench.load_frame, "read_settings", None), "read settings")
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        assert_error_in_time(read, DeviceTimeout)
        restore()

    def test_opening_moves_nothing(self, bench: LoadFrameBench) -> None:
        """Opening must not start a motion, because a motion could injure a person at the rig."""
        state = bench.load_frame.read()
        assert not state.moving
        assert state.holding
        assert state.displacement_mm == pytest.approx(0.0, abs=bench.displacement_tolerance_mm)

    def test_goes_to_a_displacement(self, bench: LoadFrameBench) -> None:
        """A move to 0.2 mm at 0.1 mm/s must take 2 s, and the machine must report its arrival."""
        bench.load_frame.go_to_displacement(0.2, 0.1)
        assert bench.load_frame.read().moving
        assert bench.arrive() == pytest.approx(2.0, rel=bench.duration_tolerance)
        state = bench.load_frame.read()
        assert state.at_target
        assert state.displacement_mm == pytest.approx(0.2, abs=bench.displacement_tolerance_mm)
        assert state.faults == ()

    def test_goes_to_a_load(self, bench: LoadFrameBench) -> None:
        """A ramp to 500 N at 250 N/s must take 2 s, and the machine must report its arrival."""
        if bench.load_frame.limits.load_rate_max_n_s == 0.0:
            pytest.skip("this load frame cannot control the load")
        bench.load_frame.go_to_load(500.0, 250.0)
        assert bench.arrive() == pytest.approx(2.0, rel=bench.duration_tolerance)
        state = bench.load_frame.read()
        assert state.at_target
        assert state.load_n == pytest.approx(500.0, abs=bench.load_tolerance_n)

    def test_a_load_frame_that_cannot_control_the_load_refuses_to(self, bench: LoadFrameBench) -> None:
        """A load frame whose largest load rate is 0 must refuse every load, without a motion."""
        if bench.load_frame.limits.load_rate_max_n_s > 0.0:
            pytest.skip("this load frame can control the load")
        for rate_n_s in (0.0, 100.0):
            with pytest.raises(DeviceFault) as refused:
                bench.load_frame.go_to_load(500.0, rate_n_s)
            assert_says_all(refused.value)
        assert not bench.load_frame.read().moving

    def test_tare_makes_the_present_state_the_zero(self, bench: LoadFrameBench) -> None:
        """After `tare`, both load and displacement must read zero."""
        bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.arrive()
        bench.load_frame.tare()
        state = bench.load_frame.read()
        assert state.load_n == pytest.approx(0.0, abs=bench.load_tolerance_n)
        assert state.displacement_mm == pytest.approx(0.0, abs=bench.displacement_tolerance_mm)

    def test_refuses_what_is_beyond_its_limits_before_anything_moves(self, bench: LoadFrameBench) -> None:
        """Targets and speeds beyond the limits must be refused, not reduced to the limit."""
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
        """After `hold` returns, the machine must stand still and accept another motion."""
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
        """From one reading to the next, the machine's sample counter must increase."""
        first = bench.load_frame.read()
        bench.clock.sleep(0.5)
        second = bench.load_frame.read()
        assert second.sample > first.sample
        assert second.time_s > first.time_s

    def test_readings_that_stand_still_are_refused(self, bench: LoadFrameBench) -> None:
        """If the sample counter stands still, `read` must raise an error, and no motion may start."""
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
        """With a broken load cell, `read` must raise an error and `hold` must still work."""
        break_load_cell = needed(bench.break_load_cell, "break the load cell")
        bench.load_frame.go_to_displacement(1.0, 0.1)
        break_load_cell()
        bench.clock.sleep(0.1)
        with pytest.raises(DeviceFault) as broken:
            bench.load_frame.read()
        assert_says_all(broken.value)
        bench.load_frame.hold()

    def test_without_a_load_that_is_one_nothing_is_set_in_motion(self, bench: LoadFrameBench) -> None:
        """With a broken load cell, the driver must refuse a motion before it sends any command to the
        machine."""
        break_load_cell = needed(bench.break_load_cell, "break the load cell")
        commands = needed(bench.commands, "count commands")
        break_load_cell()
        count = commands()
        with pytest.raises(DeviceFault):
            bench.load_frame.go_to_displacement(0.1, 0.1)
        assert commands() == count

    def test_an_open_emergency_stop_is_told_and_takes_no_motion(self, bench: LoadFrameBench) -> None:
        """While the emergency stop is pressed, `read` must report a fault and motions must be refused."""
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
        """If the machine does not answer, calls must end in time. Motions are then refused until a hold is
        confirmed."""
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        lose()
        assert_error_in_time(bench.load_frame.read, DeviceTimeout)
        restore()
        bench.load_frame.read()
        with pytest.raises(DeviceFault):
            bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.load_frame.hold()
        bench.load_frame.go_to_displacement(0.1, 0.1)
        bench.arrive()
        assert bench.load_frame.read().at_target

    def test_a_command_whose_answer_is_lost_is_executed_once_at_most(self, bench: LoadFrameBench) -> None:
        """A command whose answer is lost must not be sent again. Some machines would execute it twice."""
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
        """Calls on a closed load frame must raise `LinkLost`."""
        bench.load_frame.close()
        bench.load_frame.close()
        with pytest.raises(LinkLost) as lost:
            bench.load_frame.read()
        assert_says_all(lost.value)
