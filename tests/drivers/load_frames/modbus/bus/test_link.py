import socket
import struct
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.link import ModbusLink
from simulators.wire.tcp_server import TcpServer

Device = Callable[[bytes], bytes]
# long enough for a busy machine; tests that wait in vain take less
LONG_S, SHORT_S = 10.0, 0.2


@contextmanager
def served(device: Device, reply_timeout_s: float = LONG_S) -> Iterator[ModbusLink]:
    """Yield a link to a server; the function `device` answers requests, which include the MBAP header."""

    def converse(connection: socket.socket) -> None:
        while request := connection.recv(300):
            connection.sendall(device(request))

    server = TcpServer(converse, "127.0.0.1", 0)
    link = ModbusLink("frame", ModbusAddress(server.address), unit=1, reply_timeout_s=reply_timeout_s)
    try:
        yield link
    finally:
        link.close()
        server.close()


def reply(request: bytes, pdu: bytes) -> bytes:
    """Return an answer: the MBAP header (the request's transaction, protocol 0, length, unit) and `pdu`."""
    return request[:4] + struct.pack(">HB", len(pdu) + 1, request[6]) + pdu


def test_a_read_is_the_bytes_of_the_specification():
    requests: list[bytes] = []

    def device(request: bytes) -> bytes:
        requests.append(request)
        return reply(request, bytes.fromhex("04 02 000A"))

    with served(device) as link:
        # the specification's example: input register 9, called 8 on the wire, holds 10
        assert link.read("input", 8, 1) == [10]
    assert requests[0][2:] == bytes.fromhex("0000 0006 01 04 0008 0001")


def test_a_write_is_the_bytes_of_the_specification():
    requests: list[bytes] = []

    def device(request: bytes) -> bytes:
        requests.append(request)
        return reply(request, bytes.fromhex("10 0001 0002"))

    with served(device) as link:
        # the specification's example: 0x000A and 0x0102 to registers 2 and 3
        link.write(1, [0x000A, 0x0102])
    assert requests[0][2:] == bytes.fromhex("0000 000B 01 10 0001 0002 04 000A 0102")


@pytest.mark.parametrize(
    ("code", "meaning"), [(1, "illegal function"), (2, "illegal data address"), (6, "busy"), (99, "unknown")]
)
def test_an_exception_is_a_fault_and_not_repeated(code, meaning):
    requests: list[bytes] = []

    def device(request: bytes) -> bytes:
        requests.append(request)
        return reply(request, bytes([0x84, code]))

    with served(device) as link, pytest.raises(DeviceFault, match=f"exception {code} .*{meaning}"):
        link.read("input", 0, 1)
    assert len(requests) == 1


def test_silence_to_a_write_is_one_request_only():
    requests: list[bytes] = []

    def device(request: bytes) -> bytes:
        requests.append(request)
        return b""

    with (
        served(device, SHORT_S) as link,
        pytest.raises(DeviceTimeout, match="write holding registers 5 to 6"),
    ):
        link.write(5, [1, 2])
    assert len(requests) == 1


def test_a_read_is_repeated_once_after_silence():
    requests: list[bytes] = []

    def device(request: bytes) -> bytes:
        requests.append(request)
        return reply(request, bytes.fromhex("03 02 0007")) if len(requests) == 2 else b""

    with served(device, SHORT_S) as link:
        assert link.read("holding", 0, 1) == [7]


@pytest.mark.parametrize(
    "pdu",
    [
        "03 02 000A",  # another function
        "04 04 000A 000B",  # too many registers
        "04 00",  # none
        "84",  # a cut exception
    ],
)
def test_an_answer_to_something_else_is_not_believed(pdu):
    with (
        served(lambda request: reply(request, bytes.fromhex(pdu)), SHORT_S) as link,
        pytest.raises((LinkLost, DeviceTimeout)),
    ):
        link.read("input", 0, 1)


@pytest.mark.parametrize("pdu", ["10 0001 0001", "10 0002 0002", "03 02 0001"])
def test_a_write_that_is_acknowledged_differently_is_not_believed(pdu):
    with served(lambda request: reply(request, bytes.fromhex(pdu))) as link, pytest.raises(LinkLost):
        link.write(1, [1, 2])


def test_an_answer_of_another_transaction_or_unit_is_not_believed():
    def late(request: bytes) -> bytes:
        transaction = (int.from_bytes(request[:2], "big") - 1) % 2**16
        return transaction.to_bytes(2, "big") + reply(request, bytes.fromhex("04 02 0001"))[2:]

    def elsewhere(request: bytes) -> bytes:
        answer = bytearray(reply(request, bytes.fromhex("04 02 0001")))
        answer[6] = 2
        return bytes(answer)

    for device in (late, elsewhere):
        with served(device, SHORT_S) as link, pytest.raises((DeviceTimeout, LinkLost)):
            link.read("input", 0, 1)


def test_no_listener_is_a_lost_link(capfd):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    link = ModbusLink("frame", ModbusAddress(f"127.0.0.1:{port}"), unit=1, reply_timeout_s=0.3)
    with pytest.raises(LinkLost, match=f"expected a connection to 127.0.0.1:{port}"):
        link.read("input", 0, 1)
    link.close()
    assert capfd.readouterr().err == ""


def test_a_cut_connection_is_made_again_for_the_next_read():
    cuts = iter([True])

    def device(request: bytes) -> bytes:
        if next(cuts, False):
            raise OSError("the cable was pulled")
        return reply(request, bytes.fromhex("04 02 0001"))

    with served(device) as link:
        assert link.read("input", 0, 1) == [1]


def test_answers_to_other_requests_without_end_are_silence():
    """Each restarts no clock: the deadline is one for the whole answer."""
    strange = bytes.fromhex("7777 0000 0005 01 04 02 0001") * 100
    asked, told = threading.Event(), threading.Event()

    def converse(connection: socket.socket) -> None:
        assert connection.recv(300)
        asked.set()
        while not told.is_set():
            connection.sendall(strange)

    server = TcpServer(converse, "127.0.0.1", 0)
    link = ModbusLink("frame", ModbusAddress(server.address), unit=1, reply_timeout_s=SHORT_S)
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(link.write, 1, [1])
        assert asked.wait(60.0)
        try:
            with pytest.raises(DeviceTimeout, match=r"within 0\.2 s, got answers to other requests"):
                writing.result(60.0)
        finally:
            told.set()
            link.close()
            server.close()


def test_a_long_strange_answer_is_told_in_short():
    answer = bytes.fromhex("04 F0") + bytes(240)
    with (
        served(lambda request: reply(request, answer), SHORT_S) as link,
        pytest.raises(LinkLost, match=r"expected 1 registers, got 04 f0( 00){38} … \(242 bytes\)"),
    ):
        link.read("input", 0, 1)


@pytest.mark.parametrize("code", [10, 11])
def test_a_gateway_without_an_answer_is_asked_again_when_reading(code):
    codes = iter([code])

    def device(request: bytes) -> bytes:
        lost = next(codes, None)
        return reply(request, bytes.fromhex("04 02 0001") if lost is None else bytes([0x84, lost]))

    with served(device) as link:
        assert link.read("input", 0, 1) == [1]
    with (
        served(lambda request: reply(request, bytes([0x90, code]))) as link,
        pytest.raises(DeviceTimeout, match=f"exception {code} "),
    ):
        link.write(0, [1])


def test_a_new_connection_proves_that_the_same_machine_is_there():
    serial, requests, cuts = [5], [], iter([False, False, True])

    def device(request: bytes) -> bytes:
        requests.append(request[9])
        if next(cuts, False):
            raise OSError("the cable was pulled")
        return reply(request, bytes([4, 2, 0, serial[0] if request[9] == 32 else 1]))

    with served(device) as link:
        link.prove_by("input", 32, link.read("input", 32, 1))
        assert [link.read("input", 0, 1) for _ in range(2)] == [[1], [1]]
        # known, read, cut, proven, read again
        assert requests == [32, 0, 0, 32, 0]
        serial[0] = 6
        cuts = iter([True])
        with pytest.raises(
            LinkLost, match=r"expected the machine with \[5\] in its identity, got one with \[6\]"
        ):
            link.read("input", 0, 1)
        requests.clear()
        with pytest.raises(LinkLost, match="identity"):
            link.write(0, [1])
        assert set(requests) == {32}


def test_bytes_that_are_no_modbus_are_left_behind_with_their_connection():
    answers = iter([b"HTTP/1.1 400 Bad Request\r\n"])

    def device(request: bytes) -> bytes:
        return next(answers, None) or reply(request, bytes.fromhex("04 02 0001"))

    with served(device) as link:
        assert link.read("input", 0, 1) == [1]
