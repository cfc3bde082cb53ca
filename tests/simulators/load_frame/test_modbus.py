"""Tests with messages on a socket that were written by hand from the Modbus specification."""

import socket
import struct
import threading

import pytest

from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameServer
from tests.spring import Spring


@pytest.fixture
def server(clock):
    opened = LoadFrameServer(LoadFrameDevice(clock, Spring()))
    yield opened
    opened.close()
    opened.close()


@pytest.fixture
def client(server):
    host, _, port = server.address.partition(":")
    with socket.create_connection((host, int(port)), 10.0) as connection:
        yield connection


def exchange(client: socket.socket, request: str) -> bytes:
    """Send a complete frame, given in hexadecimal, and return the complete answer."""
    client.sendall(bytes.fromhex(request))
    header = receive(client, 7)
    return header + receive(client, int.from_bytes(header[4:6], "big") - 1)


def receive(client: socket.socket, count: int) -> bytes:
    received = b""
    while len(received) < count:
        piece = client.recv(count - len(received))
        assert piece
        received += piece
    return received


def command(code: int, sequence: int, *, displacement_mm: float = 0.0, speed_mm_s: float = 0.0) -> str:
    data = struct.pack(">HffffH", code, displacement_mm, speed_mm_s, 0.0, 0.0, sequence)
    return f"0001 0000 001B 01 10 0000 000A 14 {data.hex()}"


def test_the_state_block_is_read_in_one_request(client, clock):
    clock.sleep(1.0)
    answer = exchange(client, "ABCD 0000 0006 01 04 0000 0012")
    # transaction, protocol, length 39, unit, function, 36 bytes
    assert answer[:9] == bytes.fromhex("ABCD 0000 0027 01 04 24")
    revision, sample, status = struct.unpack(">HIH", answer[9:17])
    # 50 samples a second; ready, holding, load valid
    assert (revision, sample, status) == (1, 50, 0b1000_1001)
    assert answer[-4:] == struct.pack(">I", 1000)


def test_a_command_is_written_in_one_request_and_executed_by_its_number(client, clock):
    answer = exchange(client, command(2, 1, displacement_mm=0.5, speed_mm_s=0.1))
    assert answer == bytes.fromhex("0001 0000 0006 01 10 0000 000A")
    clock.sleep(10.0)
    state = exchange(client, "0002 0000 0006 01 04 0000 0012")[9:]
    executed, result = struct.unpack(">HH", state[10:14])
    load_n, displacement_mm = struct.unpack(">ff", state[16:24])
    assert (executed, result) == (1, 0)
    assert (load_n, displacement_mm) == (2500.0, 0.5)


def test_the_same_or_an_older_number_does_nothing(server, client, clock):
    exchange(client, command(2, 5, displacement_mm=5.0, speed_mm_s=0.1))
    clock.sleep(1.0)
    exchange(client, command(1, 6))
    for old in (6, 5, 40_000):
        exchange(client, command(2, old, displacement_mm=5.0, speed_mm_s=0.1))
    assert server.device.read().holding
    exchange(client, command(2, 7, displacement_mm=5.0, speed_mm_s=0.1))
    assert server.device.read().moving


@pytest.mark.parametrize(
    ("request_", "exception"),
    [
        ("04 000C 0009", "84 02"),  # beyond the block
        ("04 0014 0001", "84 02"),  # between blocks
        ("03 0040 0004", "83 02"),  # across two blocks
        ("04 0000 0000", "84 03"),  # no registers
        ("04 0000 007E", "84 03"),  # 126 registers
        ("04 0000", "84 03"),  # cut short
        ("01 0000 0001", "81 01"),  # coils are not served
        ("06 0000 0001", "86 02"),  # part of the command block
        ("10 0000 0001 02 0001", "90 02"),  # part of the command block
        ("10 0042 0001 04 0001", "90 03"),  # byte count and count differ
        ("10 0040 0002 04 7FC00000", "90 03"),  # a watchdog of NaN seconds
        ("10 0020 000C 18" + "7F800000" * 6, "90 03"),  # infinite limits
    ],
)
def test_requests_against_the_map_get_the_exceptions_of_the_specification(client, request_, exception):
    pdu = bytes.fromhex(request_)
    answer = exchange(client, "0007 0000" + struct.pack(">H", len(pdu) + 1).hex() + "01" + pdu.hex())
    assert answer == bytes.fromhex("0007 0000 0003 01" + exception)


def test_one_register_may_be_written_by_function_6(server, client):
    assert exchange(client, "0001 0000 0006 01 06 0042 1234") == bytes.fromhex(
        "0001 0000 0006 01 06 0042 1234"
    )
    assert server.device.heartbeat == 0x1234
    assert exchange(client, "0002 0000 0006 01 03 0042 0001")[-2:] == b"\x12\x34"


def test_another_unit_is_not_here(client):
    assert exchange(client, "0001 0000 0006 02 04 0000 0001") == bytes.fromhex("0001 0000 0003 02 84 0B")


def test_a_request_may_come_byte_by_byte_and_two_at_once(client):
    request = bytes.fromhex("0001 0000 0006 01 04 0000 0001")
    for byte in request:
        client.sendall(bytes([byte]))
    client.sendall(request + request)
    answers = receive(client, 33)
    assert answers == bytes.fromhex("0001 0000 0005 01 04 02 0001") * 3


@pytest.mark.parametrize(
    "message",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        bytes.fromhex("0001 0000 0001 01"),  # no function
        # MODBUS Messaging on TCP/IP V1.0b: 260 bytes in all are the most
        bytes.fromhex("0001 0000 00FF 01"),
    ],
)
def test_bytes_that_are_no_modbus_end_the_connection(client, message):
    client.settimeout(10.0)
    client.sendall(message)
    assert client.recv(100) == b""


def test_closing_leaves_no_thread(clock):
    before = threading.active_count()
    server = LoadFrameServer(LoadFrameDevice(clock, Spring()))
    host, _, port = server.address.partition(":")
    with socket.create_connection((host, int(port)), 10.0) as client:
        exchange(client, "0001 0000 0006 01 04 0000 0001")
        server.close()
        assert client.recv(1) == b""
    assert threading.active_count() == before


def outcome(client: socket.socket) -> tuple[int, ...]:
    """Return the sequence number and the result of the last command."""
    return struct.unpack(">HH", exchange(client, "0002 0000 0006 01 04 0005 0002")[9:])


def test_a_refusal_is_shown_until_the_next_command(client, clock):
    # 200 mm are beyond the machine's travel, 50 mm/s beyond its speed; it knows no command 9
    for number, (request, result) in enumerate(
        [
            (command(2, 1, displacement_mm=200.0, speed_mm_s=1.0), 1),
            (command(2, 2, displacement_mm=1.0, speed_mm_s=50.0), 2),
            (command(9, 3), 4),
            (command(1, 4), 0),
        ],
        start=1,
    ):
        exchange(client, request)
        assert outcome(client) == (number, result)


def test_a_machine_that_was_switched_on_again_knows_of_no_command(server, client):
    exchange(client, command(1, 7))
    assert outcome(client) == (7, 0)
    server.device.power_cycle()
    assert outcome(client) == (0, 0)


def test_set_points_apart_are_used_by_the_command_that_follows(clock, serve):
    server = serve(LoadFrameServer(LoadFrameDevice(clock, Spring()), layout=LAYOUTS["separate-words"]))
    targets = struct.pack(">ffff", 0.5, 0.25, 0.0, 0.0)
    assert server.answer(1, bytes.fromhex("10 0000 0008 10") + targets) == bytes.fromhex("10 0000 0008")
    assert server.answer(1, bytes.fromhex("10 0010 0002 04 0201 0001")) == bytes.fromhex("10 0010 0002")
    clock.sleep(1.0)
    assert server.device.displacement_mm() == pytest.approx(0.25, abs=0.25 * 0.021)


def test_a_machine_with_one_table_has_no_input_registers(clock, serve):
    server = serve(LoadFrameServer(LoadFrameDevice(clock, Spring()), layout=LAYOUTS["scaled-integers"]))
    assert server.answer(1, bytes.fromhex("04 0100 0001")) == bytes.fromhex("84 02")
    assert server.answer(1, bytes.fromhex("03 0100 0001")) == bytes.fromhex("03 02 0001")
