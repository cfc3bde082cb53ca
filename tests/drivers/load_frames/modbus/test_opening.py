"""Tests of opening a load frame: its identity, its limits, and every mistake in its settings."""

import dataclasses
from pathlib import Path

import pytest

import drivers.load_frames.modbus.load_frame
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from drivers.registry import find_driver
from simulators.load_frame.modbus import LoadFrameServer
from tests.drivers.load_frames.modbus.watched_port import Answer, is_state, settings
from tests.mistakes import mistakes_of


def test_tells_who_it_is(frame):
    assert (frame.info.model, frame.info.serial, frame.info.firmware) == ("tensile frame", "220001", "1.4")


def test_limits_are_in_the_machine(frame, device):
    assert frame.limits.displacement_max_mm == 5.3
    assert device.limits.displacement_max_mm == pytest.approx(5.3, rel=1e-7)
    assert dataclasses.astuple(device.limits) == pytest.approx(dataclasses.astuple(frame.limits), rel=1e-7)


def test_limits_wider_than_the_machine_are_refused(port, context):
    with pytest.raises(DeviceFault, match=r"write holding registers 32 to 43: .*illegal data value"):
        open_frame(settings(port.address, load_max_n=60_000.0), context)


def test_limits_that_read_back_differently_are_refused(port, context):
    def forget(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x10\x00\x20":
            return request[:5]
        return answer()

    port.tamper = forget
    with pytest.raises(DeviceFault, match=r"set limits: expected .*load_max 12000.* on reading back"):
        open_frame(settings(port.address), context)


def test_limits_that_the_machine_has_already_are_not_written_again(frame, port, context):
    """They may be kept in a memory that wears with writing."""
    written: list[bytes] = []

    def watch(request: bytes, answer: Answer) -> bytes | None:
        written.extend([request] if request[0] == 16 else [])
        return answer()

    port.tamper = watch
    open_frame(settings(port.address), context).close()
    assert written == []
    open_frame(settings(port.address, load_max_n=11_000.0), context).close()
    assert [request[:3] for request in written] == [b"\x10\x00\x20"]


def test_what_else_stands_among_the_settings_is_left_alone(port, context, tmp_path):
    """A map may declare what it does not know, and a zero may mean anything there."""
    generic = (
        Path(drivers.load_frames.modbus.load_frame.__file__).parent / "maps" / "generic.toml"
    ).read_text()
    after = 'registers.load_rate_max = { address = 42, type = "f32", unit = "N/s" }\n'
    assert after in generic
    path = tmp_path / "map.toml"
    path.write_text(generic.replace(after, after + 'registers.unknown = { address = 44, type = "u16" }\n'))
    unknown = b"\x12\x34"

    def one_more(request: bytes, answer: Answer) -> bytes | None:
        nonlocal unknown
        if request == bytes.fromhex("03 0020 000D"):
            reply = LoadFrameServer.answer(port, 1, bytes.fromhex("03 0020 000C"))
            return b"\x03\x1a" + reply[2:] + unknown
        if request[:6] == bytes.fromhex("10 0020 000D 1A"):
            unknown = request[-2:]
            LoadFrameServer.answer(port, 1, bytes.fromhex("10 0020 000C 18") + request[6:-2])
            return request[:5]
        return answer()

    port.tamper = one_more
    frame = open_frame(settings(port.address, map=str(path)), context)
    assert port.device.limits.load_max_n == 12000.0
    assert unknown == b"\x12\x34"
    frame.go_to_displacement(0.1, 0.1)
    frame.close()


def test_a_map_of_another_revision_is_refused(port, context):
    def renumber(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        return reply[:2] + b"\x00\x02" + reply[4:] if is_state(request) and reply is not None else reply

    port.tamper = renumber
    with pytest.raises(DeviceFault, match="expected register map revision 1, got 2"):
        open_frame(settings(port.address), context)


def test_nobody_at_the_address_is_told(port, context):
    address = port.address
    port.close()
    with pytest.raises(LinkLost, match="check the cable, the address"):
        open_frame(settings(address), context)


def test_a_mute_machine_is_a_timeout(port, context):
    port.tamper = lambda request, answer: None
    with pytest.raises(DeviceTimeout, match=r"expected an answer within 2 s"):
        open_frame(settings(port.address), context)


def test_another_unit_does_not_answer(port, context):
    with pytest.raises(DeviceTimeout, match=r"identify: .* expected an answer of unit 7, .*exception 11"):
        open_frame(settings(port.address, unit=7), context)


def test_two_machines_at_one_address_are_told(port, context):
    """A hold would stop the other one."""
    serials = iter([b"\x00\x01", b"\x00\x02"])

    def either(request: bytes, answer: Answer) -> bytes | None:
        reply = answer()
        if request[:3] == b"\x04\x00\x20" and reply is not None:
            return reply[:4] + next(serials) + reply[6:]
        return reply

    port.tamper = either
    with pytest.raises(DeviceFault, match="check that one machine only has this address"):
        open_frame(settings(port.address), context)


@pytest.mark.parametrize(("connections", "remedy"), [(2, "set connections to"), (1, "check that the")])
def test_a_hold_that_would_not_be_answered_is_told_on_opening(port, context, connections, remedy):
    identified = iter([False])

    def one_only(request: bytes, answer: Answer) -> bytes | None:
        if request[:3] == b"\x04\x00\x20" and next(identified, True):
            return None
        return answer()

    port.tamper = one_only
    with pytest.raises(DeviceTimeout, match=rf"check the connection for hold: .*; {remedy}"):
        open_frame(settings(port.address, reply_timeout_s=0.1, connections=connections), context)


def test_a_simulated_name_without_a_simulated_rig_is_told(context):
    with pytest.raises(LinkLost, match="no simulated rig"):
        open_frame(settings("@load_frame"), context)


def test_mistakes_in_the_rig_file_are_reported_together():
    spec = find_driver("modbus-frame")
    table = {"address": "nowhere", "load_max_n": -1.0, "colour": "red"}
    assert len(mistakes_of(spec.settings, table)) == 4


def test_mistakes_in_the_register_map_are_reported_with_those_of_the_rig_file(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text('vendor = 1\ncolour = "red"')
    table = {"address": "host:502", "load_max_n": -1.0, "displacement_max_mm": 1.0, "map": str(path)}
    mistakes = mistakes_of(find_driver("modbus-frame").settings, table)
    map_mistake, limit_mistake = sorted(mistakes, key=lambda each: each.startswith("load_max_n"))
    assert map_mistake.startswith(f"map: {path}: ")
    assert all(part in map_mistake for part in ("vendor", "colour: unknown key", "blocks: is missing"))
    assert limit_mistake.startswith("load_max_n")


def test_two_connections_mean_nothing_on_a_line():
    limits = {"load_max_n": 1000.0, "displacement_max_mm": 5.0}
    for address in ("/dev/ttyUSB0", "rtu://192.168.0.9:4001"):
        with pytest.raises(ValueError, match="`connections` is for Modbus TCP only"):
            ModbusLoadFrameSettings(address=address, connections=2, **limits)
