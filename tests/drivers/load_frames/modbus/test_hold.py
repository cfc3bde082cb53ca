"""A hold waits for no other request. It is repeated, and motions are refused, until it is confirmed."""

import struct
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.load_frame import open_frame
from tests.drivers.load_frames.modbus.watched_port import (
    COMMAND_ADDRESS,
    Answer,
    is_command,
    is_state,
    settings,
)


def test_hold_stops_the_crosshead_at_once(frame, device, clock):
    frame.go_to_displacement(1.0, 0.1)
    clock.sleep(1.0)
    frame.hold()
    clock.sleep(100.0)
    assert device.displacement_mm() == pytest.approx(0.1, abs=0.0021)
    assert frame.read().holding


def test_hold_goes_out_while_another_request_waits_for_its_answer(port, device, clock, context):
    frame = open_frame(settings(port.address, reply_timeout_s=30.0), context)
    frame.go_to_displacement(1.0, 0.1)
    asked, release = threading.Event(), threading.Event()
    first = iter([True])

    def slow(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and next(first, False):
            asked.set()
            assert release.wait(60.0)
        return reply

    port.tamper = slow
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(frame.read)
        assert asked.wait(60.0)
        frame.hold()
        assert not reading.done()
        assert device.read().holding
        release.set()
        assert reading.result(60.0).moving
    frame.close()


@pytest.mark.parametrize("start", [b"\x04\x00\x00", b"\x10\x00\x42"], ids=["state", "heartbeat"])
def test_a_machine_that_takes_one_connection_is_held_over_it(port, device, context, start):
    frame = open_frame(settings(port.address, connections=1, reply_timeout_s=30.0), context)
    frame.go_to_displacement(1.0, 0.1)
    asked = threading.Event()

    def swallow_first(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == start and not asked.is_set():
            asked.set()
            return None
        return answer()

    port.tamper = swallow_first
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(frame.read)
        assert asked.wait(60.0)
        frame.hold()
        assert device.read().holding
        # the state is asked for again behind the hold, and the heartbeat is needed no more
        assert reading.result(60.0).holding is (start[0] == 4)
    frame.close()


def test_a_motion_command_overtaken_by_hold_is_not_executed(port, device, context):
    frame = open_frame(settings(port.address, reply_timeout_s=30.0), context)
    arrived, release = threading.Event(), threading.Event()
    first = iter([True])

    def slow(request: bytes, answer: Answer) -> bytes | None:
        if is_command(request) and next(first, False):
            arrived.set()
            assert release.wait(60.0)
        return answer()

    port.tamper = slow
    with ThreadPoolExecutor(1) as pool:
        moving = pool.submit(frame.go_to_displacement, 1.0, 0.1)
        assert arrived.wait(60.0)
        frame.hold()
        release.set()
        with pytest.raises(DeviceFault, match="expected no hold meanwhile"):
            moving.result(60.0)
    assert device.read().holding
    frame.close()


def test_a_hold_does_not_wait_for_its_own_proof(port, device, clock, context):
    slow = settings(port.address, reply_timeout_s=60.0, watchdog_s=60.0)
    frame = open_frame(slow, context, StopTimes(answer_s=60.0))
    frame.go_to_displacement(1.0, 0.01)
    clock.sleep(10.5)
    states = iter([False, True])
    asked = threading.Event()

    def swallow_proof(request: bytes, answer: Answer) -> bytes | None:
        if is_state(request) and next(states, False):
            asked.set()
            return None
        return answer()

    port.tamper = swallow_proof
    with ThreadPoolExecutor(2) as pool:
        reading = pool.submit(frame.read)
        assert asked.wait(60.0)
        assert device.read().moving
        # long before the proof is overdue
        pool.submit(frame.hold).result(60.0)
        assert device.read().holding
        reading.result(60.0)
    frame.close()


def test_hold_is_repeated_until_it_is_confirmed(frame, port, device):
    frame.go_to_displacement(1.0, 0.1)
    port.commands.clear()
    lost = iter([True, True])
    port.tamper = lambda request, answer: None if is_command(request) and next(lost, False) else answer()
    frame.hold()
    assert len(port.commands) == 3
    assert device.read().holding


def test_a_hold_that_is_acknowledged_but_not_executed_is_repeated(frame, port, device):
    assert device.read().holding
    ignored = iter([True])

    def ignore(request: bytes, answer: Answer) -> bytes | None:
        return request[:5] if is_command(request) and next(ignored, False) else answer()

    port.tamper = ignore
    frame.hold()
    assert len(port.commands) == 2


def test_a_hold_is_repeated_before_a_long_answer_would_have_come(port, device, context):
    """If one attempt waited for a minute, the engine would give up before the second attempt."""
    frame = open_frame(settings(port.address, reply_timeout_s=60.0), context)
    frame.go_to_displacement(1.0, 0.1)
    lost = iter([True])
    port.tamper = lambda request, answer: None if is_command(request) and next(lost, False) else answer()
    with ThreadPoolExecutor(1) as pool:
        pool.submit(frame.hold).result(60.0)
    assert device.read().holding
    frame.close()


@pytest.mark.parametrize(("on", "off"), [(1 << 1, 0), (0, 1 << 3)], ids=["moving", "not holding"])
def test_hold_lasts_until_the_crosshead_stands(frame, port, on, off):
    braking = iter([True, True])

    def brake(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None and next(braking, False):
            status = (int.from_bytes(reply[8:10], "big") | on) & ~off
            return reply[:8] + status.to_bytes(2, "big") + reply[10:]
        return reply

    port.tamper = brake
    frame.hold()
    assert next(braking, None) is None
    assert len(port.commands) == 3


def test_hold_goes_on_from_the_number_of_whoever_commanded_the_machine_meanwhile(frame, port):
    port.answer(1, struct.pack(">BHHBHffffH", 16, COMMAND_ADDRESS, 10, 20, 1, 0, 0, 0, 0, 20_000))
    frame.hold()
    foreign, first, second = (sequence for _, sequence in port.commands)
    assert first < foreign == 20_000
    assert second == 20_001


@pytest.mark.parametrize("hold_times", [StopTimes(deadline_s=0.5)])
def test_a_hold_that_is_never_confirmed_calls_for_the_emergency_stop(frame, port):
    port.tamper = lambda request, answer: None
    with pytest.raises(DeviceTimeout, match=r"hold: expected a confirmed hold, .*press the emergency stop"):
        frame.hold()


def test_no_motion_begins_until_a_hold_was_confirmed(port, device, context):
    frame = open_frame(settings(port.address, reply_timeout_s=0.1), context, StopTimes(deadline_s=0.1))
    port.tamper = lambda request, answer: request[:5] if is_command(request) else answer()
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        frame.hold()
    port.tamper = lambda request, answer: answer()
    with pytest.raises(DeviceFault, match="a hold that was not confirmed"):
        frame.go_to_displacement(0.1, 0.1)
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)
    assert device.read().moving
    frame.close()
