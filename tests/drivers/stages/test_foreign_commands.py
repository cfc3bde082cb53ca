"""If another program or a knob moves a stage, the next reading shows it, and motions are refused."""

import pytest

from drivers.errors import DeviceFault
from tests.drivers.stages.stage_kit import arrive
from tests.drivers.stages.zaber.zaber_line import ZABER

FOREIGN = "expected only the motions of this program"


def test_a_motion_that_this_program_did_not_command_is_noticed(homed, device):
    device.move_to(300 * 6400)
    with pytest.raises(DeviceFault, match=f"{FOREIGN}, got a motion that this program did not command"):
        homed.read()


def test_a_foreign_motion_between_two_readings_shows_by_the_angle(homed, device, clock):
    homed.read()
    device.move_to(2 * 6400)
    clock.sleep(10.0)
    with pytest.raises(DeviceFault, match=f"{FOREIGN}, got an angle that changed by 2° without a command"):
        homed.read()


def test_another_target_during_a_motion_of_ours_is_noticed(homed, device, line, kit, clock):
    homed.move_to(300.0)
    clock.sleep(1.0)
    if kit is ZABER:
        device.move_to(200 * 6400)
    else:
        line.respond(b"1PA200")
    with pytest.raises(DeviceFault, match=FOREIGN):
        homed.read()


def test_no_motion_follows_until_the_stage_was_homed_again(homed, device, line, clock):
    device.move_to(2 * 6400)
    clock.sleep(10.0)
    before = len(line.motions())
    for _ in range(2):
        with pytest.raises(DeviceFault, match=FOREIGN):
            homed.move_to(10.0)
    assert len(line.motions()) == before
    homed.stop()
    homed.home()
    arrive(homed, clock)
    homed.move_to(10.0)
    assert arrive(homed, clock) == pytest.approx(10.0, abs=0.01)


def test_what_an_earlier_program_left_in_motion_is_no_foreign_command(kit, line, device, context, clock):
    device.home()
    clock.sleep(60.0)
    device.move_to(100 * 6400)
    clock.sleep(1.0)
    stage = kit.open(context, line.address)
    assert stage.read().moving
    stage.stop()
    assert not stage.read().moving
    stage.close()


def test_our_own_stop_and_our_own_moves_are_no_foreign_commands(homed, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    homed.stop()
    homed.read()
    homed.move_to(10.0)
    arrive(homed, clock)
    homed.home()
    arrive(homed, clock)
    assert homed.read().homed


def test_a_standing_stage_may_regulate_to_and_fro(homed, device):
    homed.read()
    device.set_position(device.position + round(0.04 * 6400))
    assert homed.read().angle_deg == pytest.approx(0.04, abs=1e-3)
