"""After a lost link, readings continue on a new link, but a motion first needs a confirmed hold."""

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.load_frame import open_frame
from tests.drivers.load_frames.modbus.watched_port import Answer, is_state, settings, wait


def test_a_cable_pulled_and_replugged_between_two_reads_is_survived(frame, port):
    port.drop_clients()
    assert frame.read().holding
    port.drop_clients()
    frame.hold()


@pytest.mark.parametrize("hold_times", [StopTimes(deadline_s=0.1)])
def test_a_server_that_is_gone_is_a_lost_link(frame, port):
    port.close()
    with pytest.raises(LinkLost):
        frame.read()
    with pytest.raises(DeviceTimeout, match="press the emergency stop"):
        frame.hold()


def test_after_a_lost_link_motion_waits_for_a_hold(frame, port, clock):
    silent = iter([True] * 2)
    port.tamper = lambda request, answer: None if next(silent, False) else answer()
    with pytest.raises(DeviceTimeout):
        frame.read()
    frame.read()
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)
    wait(frame, clock)
    assert frame.read().at_target


def test_silence_to_the_settings_before_a_motion_is_a_lost_link_too(frame, port):
    silent = iter([True] * 2)

    def lose_limits(request: bytes, answer: Answer) -> bytes | None:
        return None if request[:3] == b"\x03\x00\x20" and next(silent, False) else answer()

    port.tamper = lose_limits
    with pytest.raises(DeviceTimeout):
        frame.go_to_displacement(0.1, 0.1)
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)


def test_another_machine_at_the_address_is_noticed_after_a_lost_connection(frame, port, clock):
    def another(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        # input registers 32 and 33, the serial number
        return reply[:4] + b"\x00\x07" + reply[6:] if request[:3] == b"\x04\x00\x20" and reply else reply

    port.tamper = another
    assert frame.read().holding
    port.drop_clients()
    with pytest.raises(LinkLost, match=r"expected the machine with \[3, 23393, 260\] in its identity"):
        frame.read()
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
    port.tamper = lambda request, answer: answer()
    frame.hold()
    frame.go_to_displacement(0.1, 0.1)


@pytest.mark.parametrize(("connections", "after_a_pause"), [(2, 2), (1, 1)])
def test_the_connection_for_hold_is_kept_in_use(port, clock, context, connections, after_a_pause):
    """Switches and machines drop connections that are idle for hours, and only a hold would notice this."""
    frame = open_frame(settings(port.address, connections=connections), context)
    asked: list[bytes] = []

    def count(request: bytes, answer: Answer) -> bytes | None:
        asked.extend([request] if is_state(request) else [])
        return answer()

    port.tamper = count
    for pause_s, requests in ((0.1, 1), (10.5, after_a_pause), (0.1, 1)):
        clock.sleep(pause_s)
        asked.clear()
        frame.read()
        assert len(asked) == requests
    frame.close()


def test_without_a_way_for_hold_nothing_moves(frame, port, clock):
    clock.sleep(10.5)
    asked = iter([True])
    port.tamper = lambda request, answer: answer() if not is_state(request) or next(asked, False) else None
    with pytest.raises(DeviceTimeout, match="check the connection for hold"):
        frame.read()
    port.tamper = lambda request, answer: answer()
    with pytest.raises(DeviceFault, match="a link that was lost"):
        frame.go_to_displacement(0.1, 0.1)
