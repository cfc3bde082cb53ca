"""A stop of an ESP301 waits for no other request, and ends when the controller reports standstill."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages.esp301.stage import open_stage
from tests.drivers.stages.esp301.esp301_line import EspLine, settings
from tests.drivers.stages.stage_kit import Answer, stops_end_soon, untampered


def swallow_first_position(line: EspLine) -> threading.Event:
    """Make the line lose the first answer to a question for the position; this sets the returned event."""
    polled = threading.Event()

    def swallow_first(command: str, answer: Answer) -> bytes:
        if command == "1TP" and not polled.is_set():
            polled.set()
            return b""
        return answer()

    line.tamper = swallow_first
    return polled


def test_stop_goes_out_while_a_question_waits_and_the_question_is_asked_again(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    polled = swallow_first_position(line)
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(homed.read)
        assert polled.wait(60.0)
        homed.stop()
        assert not device.moving
        assert 0.0 < reading.result(60.0).angle_deg < 90.0


def test_stop_keeps_back_a_move_that_was_not_sent_yet(homed, line):
    polled = swallow_first_position(line)
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(homed.move_to, 90.0)
        assert polled.wait(60.0)
        homed.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(60.0)
    assert line.motions() == []


def test_a_stop_need_not_wait_for_the_end_of_a_question(line, context):
    stage = open_stage(settings(line.address, reply_timeout_s=60.0), context)
    polled = swallow_first_position(line)
    with ThreadPoolExecutor(2) as pool:
        reading = pool.submit(stage.read)
        assert polled.wait(60.0)
        pool.submit(stage.stop).result(60.0)
        # it is asked again
        assert not reading.result(60.0).moving
    assert line.received.count("1TP") > 1
    stage.close()


@pytest.mark.parametrize("command", ["1OR", "1PA"])
def test_a_stop_that_comes_before_the_start_was_seen_is_told(homed, line, command):
    commanded, lost = threading.Event(), iter([True])

    def lose_first_error(sent: str, answer: Answer) -> bytes:
        reply = answer()
        if sent.startswith(command):
            commanded.set()
        return b"" if commanded.is_set() and sent == "TB?" and next(lost, False) else reply

    line.tamper = lose_first_error
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(homed.home) if command == "1OR" else pool.submit(homed.move_to, 45.0)
        assert commanded.wait(60.0)
        homed.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(60.0)


def test_stop_is_repeated_until_standstill_is_confirmed(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    lost = iter([True, True])
    line.tamper = lambda command, answer: b"" if command == "1ST" and next(lost, False) else answer()
    homed.stop()
    assert not device.moving
    assert line.received.count("1ST") >= 3


@stops_end_soon
def test_a_stop_under_a_flood_ends_in_time(homed, line):
    line.tamper = lambda command, answer: b"x\n" * 2000
    with ThreadPoolExecutor(1) as pool, pytest.raises(DeviceTimeout, match="press the emergency stop"):
        pool.submit(homed.stop).result(60.0)


@stops_end_soon
@pytest.mark.parametrize("late", [0, 1])
def test_a_stray_answer_does_not_confirm_a_standstill(homed, line, clock, late):
    homed.move_to(90.0)
    clock.sleep(1.0)
    held: list[bytes] = []

    def stray(command: str, answer: Answer) -> bytes:
        if command == "1ST":
            return b""  # nor does the stop arrive
        if command == "1MD?":
            held.append(answer())
            return b"1\r\n" + (b"" if late else held.pop())
        return (held.pop() if held else b"") + answer()

    line.tamper = stray
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        homed.stop()
    line.tamper = untampered
    line.received.clear()
    assert homed.read().moving
    # the stop's own last question may be heard only now
    assert "VE?" in line.received[: line.received.index("1TP")]
