"""Tests of motions to a load or a displacement within the limits, of the tare, and of refusals."""

import math
import struct

import pytest

from drivers.errors import DeviceFault
from drivers.load_frames.modbus.load_frame import open_frame
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameServer
from tests.drivers.load_frames.modbus.watched_port import settings, wait
from tests.spring import STIFFNESS_N_MM


def test_goes_to_a_load_along_the_ramp(frame, device, clock):
    frame.go_to_load(2000.0, 200.0)
    assert wait(frame, clock) == pytest.approx(10.0, abs=0.2)
    state = frame.read()
    assert state.at_target
    assert state.faults == ()
    assert state.load_n == pytest.approx(2000.0, abs=1.0)
    assert state.displacement_mm == pytest.approx(2000.0 / STIFFNESS_N_MM, abs=1e-3)
    assert device.load_n() == pytest.approx(state.load_n, rel=1e-6)


def test_goes_to_a_displacement_at_its_speed_and_back(frame, clock):
    frame.go_to_displacement(0.3, 0.05)
    assert wait(frame, clock) == pytest.approx(6.0, abs=0.2)
    assert frame.read().displacement_mm == pytest.approx(0.3, abs=1e-6)
    frame.go_to_displacement(0.1, 0.05)
    wait(frame, clock)
    assert frame.read().load_n == pytest.approx(0.1 * STIFFNESS_N_MM, rel=1e-5)


def test_tare_makes_the_present_state_the_zero(frame, clock):
    frame.go_to_displacement(0.2, 0.1)
    wait(frame, clock)
    frame.tare()
    state = frame.read()
    assert (state.load_n, state.displacement_mm) == (0.0, 0.0)
    frame.go_to_load(500.0, 100.0)
    wait(frame, clock)
    assert frame.read().displacement_mm == pytest.approx(0.1, abs=1e-3)


def test_the_very_limit_is_allowed(frame, clock):
    frame.go_to_displacement(2.4, 1.0)
    wait(frame, clock)
    assert frame.read().load_n == pytest.approx(12000.0, rel=1e-6)
    assert frame.read().faults == ()


@pytest.mark.parametrize(
    "go",
    [
        lambda frame: frame.go_to_load(12000.1, 100.0),
        lambda frame: frame.go_to_load(-100.1, 100.0),
        lambda frame: frame.go_to_load(math.nan, 100.0),
        lambda frame: frame.go_to_load(100.0, 0.0),
        lambda frame: frame.go_to_load(100.0, 1000.1),
        lambda frame: frame.go_to_displacement(5.31, 0.1),
        lambda frame: frame.go_to_displacement(-1.01, 0.1),
        lambda frame: frame.go_to_displacement(math.inf, 0.1),
        lambda frame: frame.go_to_displacement(1.0, -0.1),
        lambda frame: frame.go_to_displacement(1.0, math.nan),
    ],
)
def test_what_is_beyond_the_limits_is_refused_before_anything_is_sent(frame, port, go):
    with pytest.raises(DeviceFault, match="correct the protocol"):
        go(frame)
    assert port.commands == []


def test_the_machine_enforces_its_limits_itself(frame, clock, device):
    frame.go_to_displacement(5.0, 1.0)
    wait(frame, clock)
    state = frame.read()
    assert state.faults == ("load limit",)
    assert state.holding
    assert device.load_n() == pytest.approx(12000.0, abs=1.0 * 0.02 * STIFFNESS_N_MM + 1.0)
    frame.go_to_displacement(0.0, 1.0)
    wait(frame, clock)
    assert frame.read().faults == ()


def test_a_refusal_of_the_machine_is_told(frame, clock):
    frame.go_to_displacement(1.0, 0.1)
    with pytest.raises(DeviceFault, match="tare: expected acceptance, got the machine is not ready"):
        frame.tare()


def test_an_open_emergency_stop_is_a_fault_and_refuses_motion(frame, device):
    device.press_estop()
    assert "emergency stop" in frame.read().faults
    with pytest.raises(DeviceFault, match="emergency stop is open"):
        frame.go_to_displacement(1.0, 0.1)


def test_set_points_that_are_not_taken_are_not_followed_by_a_command(device, context):
    commands: list[bytes] = []

    class Forgetful(LoadFrameServer):
        def answer(self, unit: int, request: bytes) -> bytes | None:
            if request[:3] == b"\x10\x00\x00":
                return request[:5]
            commands.extend([request] if request[:3] == b"\x10\x00\x10" else [])
            return super().answer(unit, request)

    server = Forgetful(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    with pytest.raises(DeviceFault, match=r"write set points: expected displacement 1, speed 0\.1, got"):
        frame.go_to_displacement(1.0, 0.1)
    assert commands == []
    frame.close()
    server.close()


def test_set_points_that_a_motion_does_not_need_stay_as_they_are(device, context):
    """A machine that stands at its load would follow a set point of 0 N before the command comes."""
    server = LoadFrameServer(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    frame.go_to_load(1500.0, 100.0)
    frame.go_to_displacement(0.25, 0.125)
    # displacement, speed, load, load rate
    reply = server.answer(1, bytes.fromhex("03 0000 0008"))
    assert struct.unpack(">ffff", reply[2:]) == (0.25, 0.125, 1500.0, 100.0)
    frame.close()
    server.close()
