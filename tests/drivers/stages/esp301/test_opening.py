"""Commands, questions and refusals while an ESP301 is opened."""

import pytest

from drivers.errors import DeviceFault
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.esp301.stage import open_stage
from tests.drivers.stages.esp301.esp301_line import settings
from tests.mistakes import mistakes_of


def test_opening_sends_what_the_manual_says_and_moves_nothing(stage, line, device):
    assert line.received[0] == "VE?"
    assert line.motions() == []
    for command in ("1SR365.00000", "1SL-5.00000", "1VA10.00000", "1SN?"):
        assert command in line.received
    assert (device.limit_min, device.limit_max) == (-5 * 6400, 365 * 6400)
    assert (stage.info.model, stage.info.serial) == ("ESP301 with URS100BCC", "110001")
    assert stage.read().warnings == ("motor off",)


def test_limits_can_be_moved_anywhere_in_the_right_order(device, line, context):
    for low, high in ((100.0, 110.0), (-20.0, -10.0), (300.0, 310.0)):
        open_stage(settings(line.address, angle_min_deg=low, angle_max_deg=high), context).close()
        assert (device.limit_min, device.limit_max) == (low * 6400, high * 6400)


@pytest.mark.parametrize("bits", ["0H", "4H", "1H", "0F8H"])
def test_limits_that_the_controller_does_not_watch_are_refused(line, context, bits):
    line.soft_limits = bits
    with pytest.raises(DeviceFault, match="software limits that are watched and stop the stage"):
        open_stage(settings(line.address), context)


def test_a_limit_that_is_not_taken_is_refused(line, context):
    line.tamper = lambda command, answer: b"180.0\r\n" if command == "1SR?" else answer()
    with pytest.raises(DeviceFault, match="set right limit: expected 365, got 180 on reading back"):
        open_stage(settings(line.address), context)


def test_another_unit_than_degrees_is_refused(line, context):
    line.tamper = lambda command, answer: b"2\r\n" if command == "1SN?" else answer()
    with pytest.raises(DeviceFault, match=r"read unit: expected degrees \(7\), got unit 2"):
        open_stage(settings(line.address), context)


def test_a_speed_beyond_the_stages_own_is_refused(line, context):
    with pytest.raises(DeviceFault, match="a speed above 0 up to 40°/s, got 41°/s"):
        open_stage(settings(line.address, speed_deg_s=41.0), context)


def test_a_home_search_that_looks_for_no_signal_is_refused(line, context):
    # 0 goes to where the counter is 0, wherever the stage was switched on
    line.home_mode = 0
    with pytest.raises(DeviceFault, match="a home search that looks for a signal"):
        open_stage(settings(line.address), context)
    table = {"port": "x", "angle_min_deg": 0.0, "angle_max_deg": 1.0, "home_mode": 0}
    (mistake,) = mistakes_of(EspSettings, table)
    assert mistake.startswith("home_mode")


def test_errors_from_before_the_opening_are_no_fault(line, device, context):
    line.answer(b"1MO")
    device.fail("FE")
    stage = open_stage(settings(line.address), context)
    state = stage.read()
    assert (state.homed, state.warnings) == (False, ())
    stage.close()
