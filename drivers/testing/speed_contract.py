"""Tests of a change of speed in motion, for load frames that have `drivers.interfaces.ChangesSpeed`."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import cast

import pytest

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.interfaces import ChangesSpeed, LoadFrame
from drivers.testing.common import assert_error_in_time, assert_says_all, needed
from drivers.testing.load_frame_bench import LoadFrameBench

TARGET_MM = 0.4
SLOW_MM_S, FAST_MM_S = 0.02, 0.1
RAMP_S = 1.0
"""Time in which the crosshead must have the new speed."""
RACES = 12
SPOKEN_SHARE = 0.01
SPOKEN_MM_S = 1e-4


def changer_of(bench: LoadFrameBench) -> ChangesSpeed:
    """Return the load frame as one that changes its speed. Skip the test if the load frame cannot."""
    needed(getattr(bench.load_frame, "change_speed", None), "change the speed of a motion")
    return cast(ChangesSpeed, bench.load_frame)


def speed_over(bench: LoadFrameBench, duration_s: float) -> float:
    """Return the mean speed in mm/s between two readings, which are `duration_s` apart."""
    first = bench.load_frame.read()
    end_s = bench.clock.now_s() + duration_s
    while bench.clock.now_s() < end_s:
        # read as often as a run does, because the machine's watchdog waits for it
        bench.clock.sleep(0.25)
        last = bench.load_frame.read()
    return (last.displacement_mm - first.displacement_mm) / (last.time_s - first.time_s)


def assert_refused(change: Callable[[], None], load_frame: LoadFrame) -> None:
    """Check that a change of speed is refused with a complete message, and that the crosshead stands."""
    with pytest.raises(DeviceFault) as refused:
        change()
    assert_says_all(refused.value)
    assert not load_frame.read().moving


class SpeedContract:
    """Tests of `ChangesSpeed`. `LoadFrameContract` inherits them; a load frame without the method skips."""

    @pytest.mark.parametrize(("before", "after"), [(SLOW_MM_S, FAST_MM_S), (FAST_MM_S, SLOW_MM_S)])
    def test_the_speed_really_changes_and_the_target_does_not(
        self, bench: LoadFrameBench, before: float, after: float
    ) -> None:
        """The displacement must grow at the new speed, and the motion must end at its target."""
        changer = changer_of(bench)
        bench.load_frame.go_to_displacement(TARGET_MM, before)
        assert speed_over(bench, 1.0) == pytest.approx(before, rel=bench.duration_tolerance)
        changer.change_speed(after)
        bench.clock.sleep(RAMP_S)
        assert speed_over(bench, 1.5) == pytest.approx(after, rel=bench.duration_tolerance)
        state = bench.load_frame.read()
        assert state.moving
        if not math.isnan(state.speed_mm_s):
            assert state.speed_mm_s == pytest.approx(after, rel=SPOKEN_SHARE, abs=SPOKEN_MM_S)
        bench.arrive()
        state = bench.load_frame.read()
        assert state.at_target
        assert state.displacement_mm == pytest.approx(TARGET_MM, abs=bench.displacement_tolerance_mm)

    def test_the_crosshead_never_stops_while_its_speed_changes(self, bench: LoadFrameBench) -> None:
        """Every reading during ten changes must find the crosshead further, and in motion."""
        changer = changer_of(bench)
        bench.load_frame.go_to_displacement(1.0, SLOW_MM_S)
        bench.clock.sleep(0.2)
        before_mm = bench.load_frame.read().displacement_mm
        for place in range(10):
            changer.change_speed(SLOW_MM_S if place % 2 else FAST_MM_S)
            bench.clock.sleep(0.25)
            state = bench.load_frame.read()
            assert state.moving
            assert not state.holding
            assert state.displacement_mm > before_mm
            before_mm = state.displacement_mm
        bench.load_frame.hold()

    def test_a_speed_that_is_none_or_beyond_the_limit_is_refused(self, bench: LoadFrameBench) -> None:
        """A refused speed must leave the motion as it was, and the machine must get no command."""
        changer = changer_of(bench)
        commands = bench.commands or (lambda: 0)
        bench.load_frame.go_to_displacement(TARGET_MM, SLOW_MM_S)
        count = commands()
        for speed_mm_s in (0.0, -0.1, bench.load_frame.limits.speed_max_mm_s * 1.01, math.nan, math.inf):
            with pytest.raises(DeviceFault) as refused:
                changer.change_speed(speed_mm_s)
            assert_says_all(refused.value)
        assert commands() == count
        assert speed_over(bench, 1.5) == pytest.approx(SLOW_MM_S, rel=bench.duration_tolerance)
        bench.load_frame.hold()

    def test_without_a_motion_a_change_is_refused_and_starts_none(self, bench: LoadFrameBench) -> None:
        """After opening, after a hold, and at the target, no motion may start."""
        changer = changer_of(bench)
        commands = bench.commands or (lambda: 0)

        def change() -> None:
            changer.change_speed(FAST_MM_S)

        assert_refused(change, bench.load_frame)
        bench.load_frame.go_to_displacement(TARGET_MM, SLOW_MM_S)
        bench.clock.sleep(0.5)
        bench.load_frame.hold()
        count, held_mm = commands(), bench.load_frame.read().displacement_mm
        assert_refused(change, bench.load_frame)
        bench.clock.sleep(1.0)
        stood_mm = bench.load_frame.read().displacement_mm
        assert stood_mm == pytest.approx(held_mm, abs=bench.displacement_tolerance_mm)
        bench.load_frame.go_to_displacement(0.1, FAST_MM_S)
        bench.arrive()
        assert_refused(change, bench.load_frame)
        assert commands() == count + (1 if bench.commands else 0)

    def test_a_ramp_of_the_load_has_no_speed_to_change(self, bench: LoadFrameBench) -> None:
        """In load control a change of speed must be refused, and the ramp must go on."""
        changer = changer_of(bench)
        if bench.load_frame.limits.load_rate_max_n_s == 0.0:
            pytest.skip("this load frame cannot control the load")
        bench.load_frame.go_to_load(500.0, 100.0)
        with pytest.raises(DeviceFault) as refused:
            changer.change_speed(FAST_MM_S)
        assert_says_all(refused.value)
        assert bench.load_frame.read().moving
        bench.arrive()
        assert bench.load_frame.read().load_n == pytest.approx(500.0, abs=bench.load_tolerance_n)

    def test_a_hold_after_a_change_is_the_last_word(self, bench: LoadFrameBench) -> None:
        """After the hold the crosshead must stand, and the next motion must be possible."""
        changer = changer_of(bench)
        bench.load_frame.go_to_displacement(1.0, SLOW_MM_S)
        bench.clock.sleep(0.5)
        changer.change_speed(FAST_MM_S)
        bench.clock.sleep(0.5)
        bench.load_frame.hold()
        state = bench.load_frame.read()
        assert state.holding
        assert not state.moving
        bench.clock.sleep(2.0)
        stood_mm = bench.load_frame.read().displacement_mm
        assert stood_mm == pytest.approx(state.displacement_mm, abs=bench.displacement_tolerance_mm)
        bench.load_frame.go_to_displacement(0.0, FAST_MM_S)
        bench.arrive()
        assert bench.load_frame.read().at_target

    def test_a_change_that_races_with_a_hold_never_outruns_it(self, bench: LoadFrameBench) -> None:
        """Whichever of the two is sent first, the crosshead must hold, and no later change may move it."""
        changer = changer_of(bench)
        for _ in range(RACES):
            bench.load_frame.go_to_displacement(1.0, SLOW_MM_S)
            with ThreadPoolExecutor(1) as pool:
                changing = pool.submit(changer.change_speed, FAST_MM_S)
                bench.load_frame.hold()
                error = changing.exception(60.0)
            assert error is None or isinstance(error, DeviceError)
            state = bench.load_frame.read()
            assert state.holding
            assert not state.moving
        with pytest.raises(DeviceFault):
            changer.change_speed(FAST_MM_S)
        assert not bench.load_frame.read().moving

    def test_a_motion_that_the_watchdog_ended_is_not_begun_again(self, bench: LoadFrameBench) -> None:
        """A change of speed must be refused after the machine's watchdog has stopped the motion."""
        changer = changer_of(bench)
        silence_s = needed(bench.watchdog_s, "wait for a watchdog")
        bench.load_frame.go_to_displacement(1.0, SLOW_MM_S)
        bench.clock.sleep(silence_s + 1.0)
        assert_refused(lambda: changer.change_speed(FAST_MM_S), bench.load_frame)
        assert bench.load_frame.read().faults

    def test_a_change_without_an_answer_is_told_in_time(self, bench: LoadFrameBench) -> None:
        """If the machine does not answer, the call must end in time, and motions wait for a hold."""
        changer = changer_of(bench)
        lose, restore = needed(bench.lose_answers, "lose answers"), needed(bench.restore, "restore")
        bench.load_frame.go_to_displacement(1.0, SLOW_MM_S)
        lose()
        assert_error_in_time(lambda: changer.change_speed(FAST_MM_S), DeviceTimeout)
        restore()
        with pytest.raises(DeviceFault):
            changer.change_speed(FAST_MM_S)
        bench.load_frame.hold()
        assert not bench.load_frame.read().moving

    def test_a_speed_that_is_confirmed_and_not_taken_is_noticed(self, bench: LoadFrameBench) -> None:
        """If the crosshead keeps its speed, the readings must tell this, or show another set speed."""
        changer = changer_of(bench)
        needed(bench.stick_speed, "make the speed stick")()
        bench.load_frame.go_to_displacement(1.0, SLOW_MM_S)
        bench.clock.sleep(0.5)

        def change_and_read() -> None:
            changer.change_speed(5.0 * SLOW_MM_S)
            speed_over(bench, 8.0)

        with pytest.raises(DeviceFault) as noticed:
            change_and_read()
        assert_says_all(noticed.value)
        bench.load_frame.hold()
        assert not bench.load_frame.read().moving
