"""Tests of the effects of a load frame's faults, on its readings and on its true state."""

import math

import numpy as np
import pytest

from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.state import FaultCode, MachineLimits, RefusedError
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.wire.faults import FaultPanel


@pytest.fixture
def device(clock):
    return LoadFrameDevice(clock, SimulatedSpecimen(SpecimenSettings(grip_slip_mm=0.0)))


@pytest.fixture
def faults(device):
    return load_frame_faults(FaultPanel("load_frame"), device)


@pytest.fixture
def moving(device, clock):
    device.go_to_displacement(1.0, 0.05)
    clock.sleep(2.0)
    assert device.read().moving
    return device


@pytest.mark.parametrize(
    ("name", "fault"),
    [("stall", FaultCode.STALL), ("limit", FaultCode.DISPLACEMENT_LIMIT), ("e-stop", FaultCode.ESTOP)],
)
def test_the_crosshead_stops_and_says_why(moving, faults, clock, name, fault):
    faults.switch_on(name)
    where_mm = moving.displacement_mm()
    clock.sleep(5.0)
    readings = moving.read()
    assert (readings.holding, readings.moving, readings.fault) == (True, False, fault)
    assert moving.displacement_mm() == pytest.approx(where_mm, abs=0.05 * 0.02)
    faults.clear()
    moving.go_to_displacement(1.0, 0.5)
    clock.sleep(5.0)
    assert moving.displacement_mm() == pytest.approx(1.0)


def test_nothing_moves_while_the_emergency_stop_is_pressed(device, faults):
    faults.switch_on("e-stop")
    with pytest.raises(RefusedError):
        device.go_to_displacement(1.0, 0.05)
    assert device.executed == []


def test_a_reset_forgets_limits_watchdog_zero_and_samples_but_not_the_crosshead(moving, faults, clock):
    moving.hold()
    moving.set_limits(MachineLimits(-10.0, 20_000.0, -1.0, 5.0, 1.0, 100.0))
    moving.set_watchdog(2.0)
    moving.tare()
    load_n = moving.load_n()
    faults.switch_on("reset")
    readings = moving.read()
    assert (readings.sample, readings.holding, moving.watchdog_s) == (0, True, 0.0)
    assert moving.limits == moving.ratings
    assert load_n == 0.0
    # 2 s at 0.05 mm/s before
    assert moving.displacement_mm() == pytest.approx(0.1)
    assert moving.power_ups == 2


def test_a_broken_load_cell_shows_no_number_but_the_load_is_there(moving, faults):
    faults.switch_on("nan-load")
    assert math.isnan(moving.read().load_n)
    assert moving.load_n() > 500.0
    faults.clear()
    assert moving.read().load_n == pytest.approx(moving.load_n())


def test_readings_stand_still_while_the_machine_goes_on(moving, faults, clock):
    faults.switch_on("frozen-counter")
    before = moving.read()
    clock.sleep(3.0)
    after = moving.read()
    assert (after.sample, after.load_n, after.displacement_mm) == (
        before.sample, before.load_n, before.displacement_mm,
    )  # fmt: skip
    assert moving.displacement_mm() == pytest.approx(0.25)
    faults.clear()
    assert moving.read().sample == 250


def test_a_broken_specimen_carries_nothing_ever_again(moving, faults, clock):
    faults.switch_on("broken-specimen")
    assert moving.read().load_n == 0.0
    faults.clear()
    clock.sleep(5.0)
    assert moving.load_n() == 0.0
    assert moving.displacement_mm() > 0.2


def test_a_watchdog_that_is_off_takes_no_time_and_never_trips(device, faults, clock):
    faults.switch_on("watchdog-off")
    device.set_watchdog(0.5)
    assert device.watchdog_s == 0.0
    device.go_to_displacement(1.0, 0.05)
    clock.sleep(5.0)
    assert device.read().moving
    faults.clear()
    device.set_watchdog(0.5)
    clock.sleep(1.0)
    assert device.read().fault is FaultCode.WATCHDOG


def test_it_keeps_what_it_was_commanded(device, clock):
    device.go_to_load(100.0, 50.0)
    clock.sleep(1.0)
    device.hold()
    device.tare()
    assert device.executed == [(0.0, "load 100 at 50"), (1.0, "hold"), (1.0, "tare")]


@pytest.mark.parametrize(
    ("name", "shown_n"),
    [
        ("zero-load", lambda true_n, before_n: 0.0),
        ("tenth-load", lambda true_n, before_n: true_n / 10.0),
        ("reversed-load", lambda true_n, before_n: -true_n),
        ("stuck-load", lambda true_n, before_n: before_n),
        ("drifting-load:40", lambda true_n, before_n: true_n - 40.0 * 3.0),
    ],
)
def test_a_lying_load_cell_shows_what_its_fault_says_until_the_fault_is_cleared(
    moving, faults, clock, name, shown_n
):
    before_n = moving.load_n()
    faults.switch_on(name)
    clock.sleep(3.0)
    true_n = moving.load_n()
    assert true_n > before_n + 500.0
    assert moving.read().load_n == pytest.approx(shown_n(true_n, before_n), abs=1e-6)
    faults.clear()
    assert moving.read().load_n == pytest.approx(true_n)


@pytest.mark.parametrize("name", ["zero-load", "tenth-load", "reversed-load", "stuck-load"])
def test_the_controller_believes_a_lying_load_cell_and_overloads_the_specimen(device, faults, clock, name):
    faults.switch_on(name)
    device.go_to_load(1000.0, 200.0)
    highest_n = 0.0
    for _ in range(80):
        clock.sleep(0.1)
        highest_n = max(highest_n, device.load_n())
    assert highest_n > 5000.0


def test_a_stuck_reading_has_no_noise(clock):
    noisy = LoadFrameDevice(clock, SimulatedSpecimen(SpecimenSettings()), rng=np.random.default_rng(1))
    faults = load_frame_faults(FaultPanel("load_frame"), noisy)
    faults.switch_on("stuck-load")
    shown = set()
    for _ in range(5):
        clock.sleep(0.1)
        shown.add(noisy.read().load_n)
    assert len(shown) == 1


def test_a_tare_zeroes_the_shown_load_and_the_true_one(moving, faults, clock):
    moving.hold()
    faults.switch_on("tenth-load")
    moving.tare()
    assert (moving.read().load_n, moving.load_n()) == (0.0, 0.0)
    moving.go_to_displacement(0.1, 0.05)
    clock.sleep(5.0)
    assert moving.read().load_n == pytest.approx(moving.load_n() / 10.0)
