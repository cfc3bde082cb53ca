"""Conditions under which a home search of an ESP301 counts as successful."""

import pytest

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages.esp301.stage import open_stage
from tests.drivers.stages.esp301.esp301_line import settings
from tests.drivers.stages.stage_kit import Answer


@pytest.mark.parametrize(("home_mode", "command"), [(None, "1OR1"), (4, "1OR4")])
def test_the_home_search_is_told_which_signals_to_look_for(line, context, home_mode, command):
    stage = open_stage(settings(line.address, home_mode=home_mode), context)
    stage.home()
    assert line.motions() == [command]
    stage.close()


def test_a_home_command_that_never_arrived_is_reported(homed, line, device):
    line.tamper = lambda command, answer: b"" if command.startswith("1OR") else answer()
    with pytest.raises(DeviceTimeout, match="home: expected a motion, got a stage that stands still"):
        homed.home()
    assert not homed.read().homed
    assert line.motions() == ["1OR1"]


def test_a_home_search_whose_error_may_have_been_lost_found_nothing(stage, line, device, clock):
    stage.home()
    clock.sleep(0.1)
    # the search hits a limit switch, and nobody hears of it: reading the queue has emptied it
    device.fail("FE")
    lost = iter([True])

    def lose(command: str, answer: Answer) -> bytes:
        reply = answer()
        return b"" if command == "TB?" and next(lost, False) else reply

    line.tamper = lose
    assert not stage.read().homed
    assert not stage.read().homed


def test_a_reading_begun_before_the_home_search_does_not_end_it(stage, line):
    def begin_search(command: str, answer: Answer) -> bytes:
        reply = answer()
        if command == "1MD?":
            stage._reference.seek()
        return reply

    line.answer(b"1MO")
    line.tamper = begin_search
    # the stage stood when it was asked, for it had not begun yet
    assert not stage.read().homed


def test_a_power_cut_right_after_the_start_of_a_home_search_is_noticed(stage, device):
    stage.home()
    device.power_cycle()
    with pytest.raises(DeviceFault, match="motor off: a reset"):
        stage.read()
