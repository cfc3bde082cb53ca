import os

import pytest

from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from tests.simulators.terminal import listen, terminal_of


@pytest.fixture
def device(clock):
    return StageDevice(clock, power_up_angle_deg=12.0)


@pytest.fixture
def server(device, clock):
    opened = NewportServer(device, clock)
    yield opened
    opened.close()
    opened.close()


def test_moves_only_with_the_motor_on_and_says_so_when_asked(server, clock):
    assert server.answer(b"1PA10.0") == b""
    # the code, the time in servo cycles of 400 µs, the text
    clock.sleep(0.4)
    assert server.answer(b"TB?") == b"113, 0, AXIS-1 MOTOR NOT ENABLED\r\n"
    assert server.answer(b"TB?") == b"0, 1000, NO ERROR DETECTED\r\n"
    assert server.answer(b"1MO;1MO?;1OR1;1MD?") == b"1\r\n0\r\n"
    clock.sleep(5.0)
    assert server.answer(b"1MD?;1TP") == b"1\r\n0.0000\r\n"
    server.answer(b"1PA10.0")
    clock.sleep(5.0)
    assert server.answer(b"1TP?;1PA?;TE?") == b"10.0000\r\n10.0000\r\n0\r\n"
    server.answer(b"1PR-2.5")
    clock.sleep(5.0)
    assert server.answer(b"1TP") == b"7.5000\r\n"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"1PA4000", 106),  # beyond the software limits
        (b"1PA-4000", 107),
        (b"1VA41", 110),  # faster than the stage can
        (b"1AC500", 111),
        (b"1VA-1", 101),
        (b"1SN2", 101),  # a rotary stage in millimetres
        (b"2PA1", 208),  # no stage there
        (b"4PA1", 9),  # three axes
        (b"PA1", 37),
        (b"1PA" + b"9" * 400, 7),
        (b"1OR7", 101),
        (b"1PA", 38),
        (b"1QQ", 6),
        (b"hello", 6),
        (b"\xff", 6),
    ],
)
def test_what_is_wrong_waits_in_the_queue(server, line, code):
    server.answer(b"1MO")
    assert server.answer(line) == b""
    assert server.answer(b"TE?;TE?") == b"%d\r\n0\r\n" % code


def test_errors_come_in_the_order_in_which_they_happened(server):
    server.answer(b"1PA1;1QQ;2PA1")
    assert server.answer(b"TE?;TE?;TE?;TE?") == b"113\r\n6\r\n208\r\n0\r\n"


def test_home_mode_0_goes_to_the_counters_zero_and_seeks_nothing(server, device, clock):
    server.answer(b"1MO;1PA20")
    clock.sleep(9.0)
    server.answer(b"1OM0;1OR")
    clock.sleep(9.0)
    # switched on at 12°, and nothing but the counter knows
    assert server.answer(b"1OM?;1TP") == b"0\r\n0.0000\r\n"
    assert device.angle_deg() == pytest.approx(12.0)
    server.answer(b"1OR1")
    clock.sleep(9.0)
    assert device.angle_deg() == pytest.approx(0.0, abs=1e-9)


def test_stop_brakes_and_abort_cuts_the_power(server, clock):
    server.answer(b"1MO;1PA90")
    clock.sleep(1.0)
    assert server.answer(b"1MD?;1ST") == b"0\r\n"
    clock.sleep(1.0)
    assert server.answer(b"1MD?;1MO?;1TV") == b"1\r\n1\r\n0.0000\r\n"
    server.answer(b"1PA200")
    clock.sleep(0.5)
    assert server.answer(b"AB;1MD?;1MO?") == b"1\r\n0\r\n"


def test_a_reset_forgets_position_motor_and_errors(server, device, clock):
    server.answer(b"1MO;1PA20;1QQ")
    clock.sleep(9.0)
    server.answer(b"RS")
    assert server.answer(b"1TP;1MO?;TE?") == b"0.0000\r\n0\r\n0\r\n"
    assert device.angle_deg() == pytest.approx(32.0)


def test_the_emergency_stop_keeps_the_motor_off(server):
    server.answer(b"1MO;1PA90")
    server.faults.switch_on("e-stop")
    assert server.answer(b"1MD?;1MO?;TE?") == b"1\r\n0\r\n4\r\n"
    assert server.answer(b"1MO;TE?;1MO?") == b"4\r\n0\r\n"
    server.faults.clear()
    assert server.answer(b"1MO;TE?;1MO?") == b"0\r\n1\r\n"


def test_a_jammed_shaft_is_a_following_error(server):
    server.faults.switch_on("stall")
    server.answer(b"1MO;1PA90")
    assert server.answer(b"1MD?;TE?;1MO?") == b"1\r\n103\r\n0\r\n"


def test_a_limit_switch_that_trips_in_every_motion_is_an_error_each_time(server, device, clock):
    server.answer(b"1MO")
    for target in (b"1PA20", b"1PA40"):
        server.answer(target)
        clock.sleep(0.5)
        device.fail("FE")
        assert server.answer(b"TE?;TE?") == b"104\r\n0\r\n"


def test_limits_speed_and_identity_can_be_read_back(server):
    server.answer(b"1SL-5;1SR365;1VA10;1SN7")
    assert server.answer(b"1SL?;1SR?;1VA?;1SN?") == b"-5.0000\r\n365.0000\r\n10.0000\r\n7\r\n"
    assert server.answer(b"VE?;1ID?") == b"ESP301 Version 3.0.1 6/1/99\r\nURS100BCC, SN 110001\r\n"


def test_lines_end_with_a_carriage_return_on_the_terminal(server):
    with terminal_of(server.address) as terminal:
        os.write(terminal, b"1MO\r1M")
        os.write(terminal, b"O?\rTE?\r")
        assert listen(terminal, 6) == b"1\r\n0\r\n"
