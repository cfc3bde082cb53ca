"""The driver refuses readings that are stale, invalid or from a restarted machine."""

import pytest

from drivers.errors import DeviceFault
from drivers.load_frames.modbus.load_frame import open_frame
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameServer
from tests.drivers.load_frames.modbus.watched_port import Answer, is_state, settings


def test_a_counter_that_stands_still_is_stale(frame, port, clock):
    frozen: list[bytes] = []

    def freeze(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None:
            frozen.append(reply)
            return frozen[0]
        return reply

    port.tamper = freeze
    frame.read()
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="read: expected a new reading, got sample 0 again after 1 s"):
        frame.read()


def test_a_restarted_machine_is_not_trusted(frame, port, clock, spring):
    clock.sleep(10.0)
    frame.read()
    port.device.power_cycle()
    clock.sleep(1.0)
    with pytest.raises(DeviceFault, match="a restarted machine"):
        frame.read()
    with pytest.raises(DeviceFault, match="a restarted machine"):
        frame.go_to_displacement(1.0, 0.1)


def test_a_restart_that_a_narrow_counter_does_not_tell_shows_in_the_commands(device, context, clock):
    server = LoadFrameServer(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    frame.tare()
    device.power_cycle()
    # nobody reads for so long that 16 bits may have gone round
    clock.sleep(60.0)
    with pytest.raises(DeviceFault, match=r"a restarted machine \(command 0 executed after \d+\)"):
        frame.read()
    frame.close()
    server.close()


def test_a_load_that_is_no_number_is_refused_but_the_machine_still_holds(frame, device, spring, clock):
    frame.go_to_displacement(1.0, 0.1)
    spring.broken_cell = True
    clock.sleep(0.1)
    with pytest.raises(DeviceFault, match="read: expected valid values, got load is no valid value"):
        frame.read()
    frame.hold()
    assert device.read().holding


def test_a_load_marked_invalid_is_refused(frame, port):
    def unmark(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_state(request) and reply is not None:
            status = int.from_bytes(reply[8:10], "big") & ~(1 << 7)
            return reply[:8] + status.to_bytes(2, "big") + reply[10:]
        return reply

    port.tamper = unmark
    with pytest.raises(DeviceFault, match="a load marked invalid"):
        frame.read()


def test_the_time_of_a_reading_is_that_of_its_answer(frame, port, clock):
    def slow_heartbeat(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x10\x00\x42":
            clock.sleep(0.4)
        return answer()

    port.tamper = slow_heartbeat
    asked_s = clock.now_s()
    assert frame.read().time_s == asked_s


def test_a_status_apart_is_read_before_the_readings(device, context):
    """Or "at target" might be newer than a load from before the target."""
    asked: list[int] = []

    class Watched(LoadFrameServer):
        def answer(self, unit: int, request: bytes) -> bytes | None:
            asked.extend([request[2]] if request[0] == 4 else [])
            return super().answer(unit, request)

    server = Watched(device, layout=LAYOUTS["separate-words"])
    frame = open_frame(settings(server.address, map="separate-words"), context)
    asked.clear()
    frame.read()
    assert asked == [16, 0]
    frame.close()
    server.close()
