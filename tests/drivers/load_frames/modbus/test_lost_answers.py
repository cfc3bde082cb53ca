"""If the answer to a command is lost, its number shows its execution. No command is executed twice."""

import pytest

from drivers.errors import DeviceFault, DeviceTimeout
from tests.drivers.load_frames.modbus.watched_port import Answer, is_command, wait


def test_a_command_whose_answer_is_lost_is_proven_by_its_number_and_sent_once(frame, port, clock):
    def lose(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        return None if is_command(request) else reply

    port.tamper = lose
    frame.go_to_displacement(0.3, 0.1)
    assert len(port.commands) == 1
    wait(frame, clock)
    assert frame.read().displacement_mm == pytest.approx(0.3, abs=1e-6)


def test_a_connection_that_ends_with_a_command_leaves_it_to_be_proven(frame, port, device):
    def cut(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if is_command(request):
            raise OSError("the cable was pulled")
        return reply

    port.tamper = cut
    frame.go_to_displacement(0.3, 0.1)
    assert len(port.commands) == 1
    assert device.read().moving


def test_an_answer_lost_behind_a_gateway_is_a_lost_answer(frame, port, device):
    """Exceptions 10 and 11 come from the gateway, so the machine may have executed the command."""
    lost = iter([True])

    def lose(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        return bytes([0x90, 11]) if is_command(request) and next(lost, False) else reply

    port.tamper = lose
    frame.go_to_displacement(0.3, 0.1)
    assert device.read().moving
    assert len(port.commands) == 1
    silent = iter([True])
    port.tamper = lambda request, answer: b"\x84\x0b" if next(silent, False) else answer()
    assert frame.read().moving


def test_a_command_that_never_arrived_is_sent_again_under_the_same_number(frame, port):
    lost = iter([True])
    port.tamper = lambda request, answer: None if is_command(request) and next(lost, False) else answer()
    frame.tare()
    assert len(port.commands) == 2
    assert port.commands[0][1] == port.commands[1][1]


def test_a_command_that_never_arrives_is_a_timeout(frame, port, device):
    port.tamper = lambda request, answer: None if is_command(request) else answer()
    with pytest.raises(DeviceTimeout, match=r"command \d+ executed, got command 0 as the last one"):
        frame.go_to_displacement(0.3, 0.1)
    assert device.read().holding


def test_after_a_command_that_was_not_confirmed_motion_waits_for_a_hold(frame, port, device):
    """The command may still be on its way, and arrive unexpectedly."""
    lost: list[bytes] = []

    def delay(request: bytes, answer: Answer) -> bytes | None:
        if is_command(request) and len(lost) < 2:
            lost.append(request)
            return request[:5]
        return answer()

    port.tamper = delay
    with pytest.raises(DeviceTimeout, match=r"expected command \d+ executed"):
        frame.go_to_displacement(0.1, 0.1)
    with pytest.raises(DeviceFault, match="a command that was not confirmed"):
        frame.go_to_displacement(0.2, 0.1)
    frame.hold()
    port.answer(1, lost[0])
    assert device.read().holding
