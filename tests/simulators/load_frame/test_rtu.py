"""Tests of Modbus RTU on a pseudo-terminal and on TCP, with frames of the specification."""

import os
import socket

import pytest

import simulators.wire.modbus
from drivers.clock import VirtualClock
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.modbus import LoadFrameRtuServer
from simulators.wire.modbus import crc, cut_rtu
from tests.simulators.terminal import listen, terminal_of
from tests.spring import Spring
from tests.tcp_servers import load_frame_rtu_on_tcp


@pytest.fixture
def device():
    return LoadFrameDevice(VirtualClock(), Spring())


@pytest.fixture
def terminal(device):
    server = LoadFrameRtuServer(device)
    with terminal_of(server.address) as opened:
        yield opened
    server.close()
    server.close()


def exchange(terminal: int, request: str, size: int) -> str:
    """Send a message, given in hexadecimal, and return the answer of `size` bytes and any further bytes."""
    os.write(terminal, bytes.fromhex(request))
    return listen(terminal, size).hex(" ")


@pytest.mark.parametrize(
    ("message", "checksum"),
    [
        # MODBUS over Serial Line V1.02, 6.2.2: the message 02 07 has the checksum 0x1241, low byte first
        ("02 07", "41 12"),
        # the catalogue of parametrised CRC algorithms: CRC-16/MODBUS of "123456789" is 0x4B37
        (b"123456789".hex(), "37 4b"),
    ],
)
def test_the_checksum_is_the_specifications(message, checksum):
    assert crc(bytes.fromhex(message)).hex(" ") == checksum


def sealed(message: str) -> str:
    return message + crc(bytes.fromhex(message)).hex()


def test_reads_and_writes_as_on_tcp(terminal, device):
    assert exchange(terminal, sealed("01 04 00 20 00 03"), 11) == "01 04 06 00 03 5b 61 01 04 66 3a"
    assert exchange(terminal, sealed("01 06 00 42 00 07"), 8) == "01 06 00 42 00 07 68 1c"
    assert device.heartbeat == 7
    # exception 2, illegal data address
    assert exchange(terminal, sealed("01 03 01 00 00 01"), 5) == "01 83 02 c0 f1"


@pytest.mark.parametrize(
    "request_",
    [
        "01 04 00 20 00 03 00 00",  # wrong checksum
        sealed("02 04 00 20 00 03"),  # for another unit
        "01 04",  # cut short
    ],
)
def test_what_is_damaged_or_for_others_is_met_with_silence(terminal, request_):
    assert exchange(terminal, request_, 0) == ""
    # and the line is whole again with the next request
    assert exchange(terminal, sealed("01 04 00 20 00 03"), 11).startswith("01 04 06")


def test_everybody_obeys_unit_0_and_nobody_answers(terminal, device):
    assert exchange(terminal, sealed("00 06 00 42 00 09"), 0) == ""
    assert device.heartbeat == 9


def test_requests_may_come_in_pieces_or_together(terminal):
    request = bytes.fromhex(sealed("01 04 00 20 00 03"))
    os.write(terminal, request[:3])
    assert exchange(terminal, (request[3:] + request).hex(), 22).count("01 04 06") == 2


def test_unknown_functions_are_told(terminal):
    assert exchange(terminal, sealed("01 2b 0e 01 00"), 5).startswith("01 ab 01")


def test_noise_before_a_request_is_passed_over():
    request = bytes.fromhex(sealed("01 10 00 40 00 02 04 40 00 00 00"))
    assert cut_rtu(b"\x00\xff\x10" + request + request[:4]) == ([request], request[:4])


def test_no_stretch_longer_than_a_message_is_checked(monkeypatch):
    """A chunk of noise would keep the device busy for seconds otherwise."""
    checked: list[int] = []

    def count(data: bytes) -> bytes:
        checked.append(len(data) + 2)
        return crc(data)

    monkeypatch.setattr(simulators.wire.modbus, "crc", count)
    noise = bytes([0x2B, 0x10]) * 2048
    assert cut_rtu(noise) == ([], noise[-256:])
    # MODBUS over Serial Line V1.02, 2.3: 256 bytes are the most
    assert max(checked) <= 256


def test_the_same_frames_on_tcp(device, serve):
    server = serve(load_frame_rtu_on_tcp(device))
    host, _, port = server.address.partition(":")
    with socket.create_connection((host, int(port)), 10.0) as client:
        client.sendall(bytes.fromhex(sealed("01 04 00 20 00 03")))
        assert client.makefile("rb").read(11).hex(" ") == "01 04 06 00 03 5b 61 01 04 66 3a"
