"""Conditions under which a Zaber stage gains and loses its reference position."""

import pytest

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages.zaber.stage import ZaberStage
from tests.drivers.stages.stage_kit import arrive, untampered
from tests.drivers.stages.zaber.zaber_line import lose

# the faults among the constants of the vendor's client (zaber-motion, WarningFlags), one it has not got,
# and the limit switch, after which a motion has failed too
FAULTS = [f"F{letter}" for letter in "FNZHVOCMDQIARSBPETX"] + ["WL"]


def test_homing_switches_a_motor_driver_on_again(homed, device, line, clock):
    device.fail("FD")
    homed.home()
    arrive(homed, clock)
    assert "driver enable" in line.received
    assert homed.read().homed


def test_a_home_command_that_never_arrived_is_no_home_search(homed, line, device):
    device.fail("FS")
    line.tamper = lambda command, answer: b"" if command == "home" else answer()
    # the stage still has the reference it had before it stalled, and stands still as if it had found it
    with pytest.raises(DeviceTimeout, match="home: expected a motion, got silence"):
        homed.home()
    line.tamper = untampered
    assert not homed.read().homed
    assert line.motions() == ["home"]


def test_a_home_search_whose_answer_is_lost_counts_when_it_has_ended(stage, line, clock):
    line.tamper = lose("home")
    stage.home()
    assert not stage.read().homed
    arrive(stage, clock)
    assert stage.read().homed
    assert line.motions() == ["home"]


def test_a_search_that_somebody_else_stopped_leaves_no_reference(homed, device, clock):
    device.fail("FS")
    homed.home()
    device.stop()
    clock.sleep(10.0)
    with pytest.raises(DeviceFault, match="a motion that another program interrupted"):
        homed.read()
    homed.home()
    arrive(homed, clock)
    assert homed.read().homed


def test_a_stopped_search_after_a_fault_leaves_no_reference(homed, device, clock):
    device.fail("FS")
    homed.home()
    homed.stop()
    # the stage itself still calls its reference good
    assert homed.read().warnings == ("NI",)
    assert not homed.read().homed
    with pytest.raises(DeviceFault, match="home the stage first"):
        homed.move_to(10.0)
    homed.home()
    arrive(homed, clock)
    homed.move_to(10.0)
    assert arrive(homed, clock) == 10.0


def test_a_stopped_search_leaves_no_reference_though_another_program_cleared_the_flags(homed, device):
    device.fail("FS")
    homed.home()
    homed.stop()
    device.clear_flags()
    assert homed.read().warnings == ()
    assert not homed.read().homed


def test_a_reading_under_way_when_a_search_is_stopped_does_not_end_it(homed, device, monkeypatch):
    homed.home()
    query = homed._query

    def stop_first(*given: object) -> object:
        monkeypatch.undo()
        homed.stop()
        device.clear_flags()
        return query(*given)

    monkeypatch.setattr(homed, "_query", stop_first)
    assert not homed.read().homed
    assert not homed.read().homed


def test_a_reference_lost_in_a_power_cut_is_noticed(homed, device):
    device.power_cycle()
    assert not homed.read().homed
    with pytest.raises(DeviceFault, match="no reference position"):
        homed.move_to(10.0)


@pytest.mark.parametrize("begin", [ZaberStage.home, lambda stage: stage.move_to(90.0)], ids=["home", "move"])
def test_a_fault_in_motion_leaves_no_reference_though_it_went_by_itself(homed, device, begin):
    begin(homed)
    device.fail("FH")
    with pytest.raises(DeviceFault, match="emergency stop"):
        homed.read()
    device.enable_driver()
    # the stage itself still calls its reference good
    assert homed.read().warnings == ()
    assert not homed.read().homed


@pytest.mark.parametrize("flag", FAULTS)
def test_a_failed_motion_is_a_fault_until_homing_acknowledges_it(homed, device, clock, flag):
    homed.move_to(90.0)
    clock.sleep(1.0)
    device.fail(flag)
    for _ in range(2):
        with pytest.raises(DeviceFault, match=f"read position: expected no fault, got .*{flag}"):
            homed.read()
    with pytest.raises(DeviceFault, match=flag):
        homed.move_to(10.0)
    device.enable_driver()
    homed.home()
    arrive(homed, clock)
    assert homed.read().warnings == ()
