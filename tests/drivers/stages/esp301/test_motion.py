"""An ESP301's refusal of a motion is reported with its reason, and faults are reported until `home`."""

import pytest

from drivers.errors import DeviceFault
from tests.drivers.stages.stage_kit import Answer, arrive


def test_a_move_to_where_it_stands_is_done(homed):
    homed.move_to(0.0)
    assert homed.read().angle_deg == 0.0


def test_a_refused_move_is_told_with_the_controllers_reason(homed, line):
    line.faults.switch_on("error:115:1")
    with pytest.raises(DeviceFault, match=r"move to 20°: expected acceptance, got error 115 \(axis-1 max"):
        homed.move_to(20.0)


def test_a_move_beyond_the_controllers_limits_is_refused_and_fails_nothing(homed, line):
    line.faults.switch_on("error:106:1")
    with pytest.raises(DeviceFault, match=r"move to 20°: expected acceptance, got error 106"):
        homed.move_to(20.0)
    assert homed.read().homed


def test_a_failure_that_another_command_heard_of_first_is_not_forgotten(homed, line, device, clock):
    def run_into_a_limit_switch(command: str, answer: Answer) -> bytes:
        reply = answer()
        if command.startswith("1PA"):
            # it stops the stage, and leaves the motor on
            device.fail("FE")
        return reply

    line.tamper = run_into_a_limit_switch
    with pytest.raises(DeviceFault, match="move to 90°: expected acceptance, got error 104"):
        homed.move_to(90.0)
    for _ in range(2):
        with pytest.raises(DeviceFault, match="read position: expected no fault, got error 104"):
            homed.read()
    homed.home()
    arrive(homed, clock)
    assert homed.read().homed


def test_an_open_emergency_stop_is_a_fault_until_homing_acknowledges_it(homed, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    device.press_estop()
    for _ in range(2):
        with pytest.raises(DeviceFault, match="read position: expected no fault, got error 4"):
            homed.read()
    with pytest.raises(DeviceFault, match="emergency stop"):
        homed.home()
    device.release_estop()
    homed.home()
    arrive(homed, clock)
    assert homed.read().homed


def test_a_reset_is_noticed_by_the_motor_that_is_off(homed, device):
    device.power_cycle()
    with pytest.raises(DeviceFault, match="motor off: a reset, a power cut or an emergency stop"):
        homed.read()


def test_a_reset_and_a_motor_switched_on_behind_our_back_are_noticed_by_the_limits(homed, device, line):
    device.power_cycle()
    line.answer(b"VE?")
    line.answer(b"1MO")
    device.limit_max = 170 * 6400
    assert homed.read().homed
    with pytest.raises(DeviceFault, match="the limit 365° that was set, got 170°: the controller was reset"):
        homed.move_to(20.0)
    assert not homed.read().homed
    assert line.motions() == []
