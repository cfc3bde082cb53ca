"""A stop of a Zaber stage waits for no other request, and ends when the stage reports standstill."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

import drivers.stages.guarded
import drivers.stages.zaber.stage
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages.zaber.protocol import lrc
from drivers.stages.zaber.stage import open_stage
from tests.drivers.stages.stage_kit import Answer, arrive, stops_end_soon
from tests.drivers.stages.zaber.zaber_line import answered, settings


def test_stop_goes_out_while_another_request_waits_for_its_answer(line, device, clock, context):
    stage = open_stage(settings(line.address, reply_timeout_s=30.0), context)
    stage.home()
    arrive(stage, clock)
    stage.move_to(90.0)
    clock.sleep(1.0)
    polled = threading.Event()
    held: list[bytes] = []

    def hold_back(command: str, answer: Answer) -> bytes:
        if command == "get pos":
            held.append(answer())
            polled.set()
            return b""
        return answer()

    line.tamper = hold_back
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(stage.read)
        assert polled.wait(60.0)
        stage.stop()
        assert not reading.done()
        assert not device.moving
        line.tamper = lambda command, answer: held.pop() + answer()
        # any further traffic brings the late answer along
        stage.stop()
        assert reading.result(60.0).moving
    stage.close()


def test_stop_keeps_back_a_move_that_was_not_sent_yet(line, device, clock, context):
    stage = open_stage(settings(line.address, reply_timeout_s=30.0), context)
    stage.home()
    arrive(stage, clock)
    polled = threading.Event()
    held: list[bytes] = []

    def hold_back(command: str, answer: Answer) -> bytes:
        if command == "get pos":
            held.append(answer())
            polled.set()
            return b""
        return (held.pop() if held else b"") + answer()

    line.received.clear()
    line.tamper = hold_back
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(stage.move_to, 90.0)
        assert polled.wait(60.0)
        stage.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(60.0)
    assert line.motions() == []
    stage.close()


@pytest.mark.parametrize("command", ["home", "move"])
def test_a_stop_while_the_answer_to_a_motion_is_missing_is_told(homed, line, command):
    commanded = threading.Event()

    def lose_motion(sent: str, answer: Answer) -> bytes:
        reply = answer()
        if not sent.startswith(command):
            return reply
        commanded.set()
        return b""

    line.tamper = lose_motion
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(homed.home) if command == "home" else pool.submit(homed.move_to, 45.0)
        assert commanded.wait(60.0)
        homed.stop()
        with pytest.raises(DeviceFault, match="no stop meanwhile"):
            moving.result(60.0)


def test_stop_is_repeated_until_standstill_is_confirmed(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)
    lost = iter([True, True])
    line.tamper = lambda command, answer: b"" if next(lost, False) else answer()
    homed.stop()
    assert not device.moving
    # two lost, then at least the one that began to brake and the one that saw the standstill
    assert line.received.count("stop") >= 4


@stops_end_soon
def test_a_refused_stop_is_no_standstill(homed, line):
    line.tamper = lambda command, answer: answered(answer(), "RJ IDLE -- AGAIN")
    with pytest.raises(DeviceTimeout, match=r"got rejection AGAIN .*press the emergency stop"):
        homed.stop()


@stops_end_soon
def test_another_devices_standstill_is_not_this_ones(homed, line, device, clock):
    homed.move_to(90.0)
    clock.sleep(1.0)

    def foreign(command: str, answer: Answer) -> bytes:
        body = line.readdressed(answer()).decode()[1:].partition(":")[0].replace("BUSY", "IDLE")
        return f"@{body}:{lrc(body)}\r\n".encode()

    line.tamper = foreign
    with pytest.raises(DeviceTimeout, match="an answer of device 2; press the emergency stop"):
        homed.stop()


def test_a_new_link_for_a_stop_is_not_waited_for_longer_than_a_stop_lasts(line, context, monkeypatch):
    opened = []

    class Noted(drivers.stages.zaber.stage.ZaberPort):
        def __init__(self, name: str, url: str, reply_timeout_s: float) -> None:
            opened.append(reply_timeout_s)
            super().__init__(name, url, reply_timeout_s)

    monkeypatch.setattr(drivers.stages.zaber.stage, "ZaberPort", Noted)
    stage = open_stage(settings(line.address, reply_timeout_s=60.0), context)
    line.faults.switch_on("unplug")
    line.faults.clear()
    stage.stop()
    assert opened == [60.0, 1.0]
    stage.close()


def test_a_stage_on_a_port_that_failed_is_stopped_over_the_same_port(homed, device, clock, monkeypatch):
    homed.move_to(90.0)
    clock.sleep(1.0)

    def fail(data: bytes) -> None:
        raise OSError("write timeout")

    monkeypatch.setattr(homed._port._channel, "send", fail)
    homed.stop()
    assert not device.moving
