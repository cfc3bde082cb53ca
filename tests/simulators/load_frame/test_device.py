import numpy as np
import pytest

from drivers.clock import VirtualClock
from simulators.load_frame.device import CONTROL_PERIOD_S, LoadFrameDevice
from simulators.load_frame.state import FaultCode, MachineLimits, Refusal, RefusedError
from tests.spring import STIFFNESS_N_MM, Spring


class Yielding:
    """A load string of an elastic, perfectly plastic material: 5 kN/mm up to 4 kN."""

    def __init__(self) -> None:
        self.permanent_mm = 0.0

    def stretch_to(self, displacement_mm: float) -> float:
        self.permanent_mm = max(self.permanent_mm, displacement_mm - 4000.0 / STIFFNESS_N_MM)
        return STIFFNESS_N_MM * (displacement_mm - self.permanent_mm)


@pytest.fixture
def frame(clock: VirtualClock) -> LoadFrameDevice:
    return LoadFrameDevice(clock, Spring(), load_max_n=20_000.0, displacement_max_mm=50.0)


def test_displacement_grows_at_constant_speed(frame, clock):
    frame.go_to_displacement(1.0, 0.1)
    for second in range(1, 10):
        clock.sleep(1.0)
        assert frame.displacement_mm() == pytest.approx(0.1 * second, abs=0.1 * CONTROL_PERIOD_S)
    clock.sleep(10.0)
    assert frame.displacement_mm() == pytest.approx(1.0)
    assert frame.read().at_target


def test_load_follows_its_ramp(frame, clock):
    frame.go_to_load(4000.0, 400.0)
    for second in range(1, 10):
        clock.sleep(1.0)
        assert frame.load_n() == pytest.approx(400.0 * second, abs=400.0 * CONTROL_PERIOD_S)
    clock.sleep(10.0)
    assert frame.load_n() == pytest.approx(4000.0, abs=1.0)
    frame.go_to_load(1000.0, 400.0)
    clock.sleep(1.0)
    assert frame.load_n() == pytest.approx(3600.0, abs=400.0 * CONTROL_PERIOD_S)
    clock.sleep(9.0)
    assert frame.load_n() == pytest.approx(1000.0, abs=1.0)


def test_the_way_does_not_depend_on_how_often_it_is_asked(clock):
    often = LoadFrameDevice(clock, Yielding())
    rarely = LoadFrameDevice(clock, Yielding())
    for device in (often, rarely):
        device.go_to_load(3900.0, 200.0)
    for _ in range(500):
        clock.sleep(0.05)
        often.read()
    assert often.load_n() == rarely.load_n()
    assert often.displacement_mm() == rarely.displacement_mm()


def test_a_load_that_a_yielding_specimen_never_carries_ends_at_the_travel_limit(clock):
    frame = LoadFrameDevice(clock, Yielding(), displacement_max_mm=3.0)
    frame.go_to_load(5000.0, 200.0)
    clock.sleep(600.0)
    state = frame.read()
    assert state.fault is FaultCode.DISPLACEMENT_LIMIT
    assert state.holding
    # tripped within one control period at the greatest speed
    assert 3.0 < state.displacement_mm < 3.0 + 10.0 * CONTROL_PERIOD_S + 1e-3


def test_the_load_limit_trips_on_the_way_out_and_leaves_the_way_back_free(frame, clock):
    frame.go_to_displacement(10.0, 1.0)
    clock.sleep(20.0)
    assert frame.read().fault is FaultCode.LOAD_LIMIT
    assert frame.load_n() == pytest.approx(20_000.0, abs=1.0 * CONTROL_PERIOD_S * STIFFNESS_N_MM + 1.0)
    frame.go_to_displacement(3.0, 1.0)
    clock.sleep(20.0)
    assert frame.read().fault is FaultCode.NONE
    assert frame.load_n() == pytest.approx(15_000.0)


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (lambda frame: frame.go_to_load(20_001.0, 1.0), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.go_to_load(float("nan"), 1.0), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.go_to_displacement(50.1, 1.0), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.go_to_displacement(1.0, 10.1), Refusal.TOO_FAST),
        (lambda frame: frame.go_to_displacement(1.0, 0.0), Refusal.TOO_FAST),
        (lambda frame: frame.set_limits(MachineLimits(0, 20_001.0, 0, 1, 1, 1)), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.set_limits(MachineLimits(0, float("nan"), 0, 1, 1, 1)), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.set_limits(MachineLimits(10, 0, 0, 1, 1, 1)), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.set_watchdog(float("nan")), Refusal.BEYOND_LIMITS),
        (lambda frame: frame.set_watchdog(60.1), Refusal.BEYOND_LIMITS),
    ],
)
def test_commands_beyond_the_limits_are_refused(frame, command, reason):
    with pytest.raises(RefusedError) as caught:
        command(frame)
    assert caught.value.reason is reason
    assert frame.read().holding


def test_the_watchdog_trips_only_while_moving_and_without_new_beats(frame, clock):
    frame.set_watchdog(1.0)
    clock.sleep(100.0)
    assert frame.read().fault is FaultCode.NONE
    frame.go_to_displacement(10.0, 0.1)
    for beat in range(1, 6):
        clock.sleep(0.9)
        frame.beat(beat)
    assert frame.read().moving
    for _ in range(3):
        clock.sleep(0.9)
        frame.beat(5)
    assert frame.read().fault is FaultCode.WATCHDOG
    # 5 × 0.9 s with beats, 1 s without
    assert frame.displacement_mm() == pytest.approx(0.55, abs=0.1 * 2 * CONTROL_PERIOD_S)


def test_an_emergency_stop_stands_until_released_and_commanded(frame, clock):
    frame.go_to_displacement(10.0, 1.0)
    clock.sleep(1.0)
    frame.press_estop()
    clock.sleep(1.0)
    assert frame.displacement_mm() == pytest.approx(1.0, abs=CONTROL_PERIOD_S)
    with pytest.raises(RefusedError, match="NOT_READY"):
        frame.go_to_displacement(2.0, 1.0)
    frame.release_estop()
    clock.sleep(1.0)
    assert frame.displacement_mm() == pytest.approx(1.0, abs=CONTROL_PERIOD_S)
    frame.go_to_displacement(2.0, 1.0)
    assert frame.read().fault is FaultCode.NONE


def test_noise_is_as_large_as_stated_and_once_per_sample(clock):
    frame = LoadFrameDevice(clock, Spring(), rng=np.random.default_rng(7))
    loads, displacements = [], []
    for _ in range(4000):
        clock.sleep(CONTROL_PERIOD_S * 1.0001)
        reading = frame.read()
        assert frame.read() == reading
        loads.append(reading.load_n)
        displacements.append(reading.displacement_mm)
    # the standard deviation of 4000 samples is within 5 standard errors, 1/sqrt(8000) each
    assert np.std(loads) == pytest.approx(2.0, rel=5 / 8000**0.5)
    assert np.std(displacements) == pytest.approx(0.2e-3, rel=5 / 8000**0.5)
    assert frame.load_n() == 0.0


def test_tare_sets_both_zeros(frame, clock):
    frame.go_to_displacement(1.0, 1.0)
    with pytest.raises(RefusedError, match="NOT_READY"):
        frame.tare()
    clock.sleep(2.0)
    frame.tare()
    assert (frame.load_n(), frame.displacement_mm()) == (0.0, 0.0)


def test_the_lower_load_limit_trips(frame, clock):
    frame.set_limits(MachineLimits(-1000.0, 1000.0, -5.0, 5.0, 5.0, 100.0))
    frame.go_to_displacement(-0.5, 0.5)
    clock.sleep(2.0)
    assert frame.read().fault is FaultCode.LOAD_LIMIT
    # 1 kN at 5 kN/mm, and two control periods
    assert frame.displacement_mm() == pytest.approx(-0.2, abs=0.5 * 2 * CONTROL_PERIOD_S)


def test_the_lower_travel_limit_trips(frame, clock):
    frame.set_limits(MachineLimits(-9000.0, 1000.0, -0.5, 5.0, 5.0, 100.0))
    frame.go_to_load(-5000.0, 100.0)
    clock.sleep(60.0)
    assert frame.read().fault is FaultCode.DISPLACEMENT_LIMIT
    assert frame.displacement_mm() == pytest.approx(-0.5, abs=100.0 / STIFFNESS_N_MM)


def test_out_of_limits_that_were_narrowed_meanwhile_the_way_back_is_free(frame, clock):
    frame.go_to_displacement(3.0, 5.0)
    clock.sleep(2.0)
    frame.set_limits(MachineLimits(-100.0, 10_000.0, -1.0, 2.5, 1.0, 100.0))
    frame.go_to_displacement(1.0, 0.1)
    clock.sleep(30.0)
    assert (frame.read().fault, frame.displacement_mm()) == (FaultCode.NONE, pytest.approx(1.0))


def test_after_a_tare_it_holds_position(frame, clock):
    """A load controller would go on to its target, now from another zero."""
    frame.go_to_load(1000.0, 500.0)
    clock.sleep(10.0)
    assert not frame.read().holding
    frame.tare()
    clock.sleep(10.0)
    assert (frame.read().holding, frame.load_n()) == (True, 0.0)


def test_a_zero_set_under_load_moves_the_limits_but_not_what_the_machine_bears(frame, clock):
    """Rated for 20 kN, with 15 kN zeroed away, there are 5 left."""
    frame.go_to_load(15_000.0, 5000.0)
    clock.sleep(10.0)
    frame.tare()
    frame.go_to_displacement(3.0, 0.5)
    clock.sleep(10.0)
    assert frame.read().fault is FaultCode.LOAD_LIMIT
    # within what one control period at 0.5 mm/s adds
    assert frame.load_n() == pytest.approx(5000.0, abs=0.5 * CONTROL_PERIOD_S * STIFFNESS_N_MM + 2.0)
