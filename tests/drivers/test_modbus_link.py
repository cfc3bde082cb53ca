import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.modbus_address import ModbusAddress
from drivers.modbus_link import ModbusLink
from simulators.tcp_server import TcpServer

Device = Callable[[bytes], bytes]
# long enough for a busy machine; tests that wait for nothing have less patience
PATIENT_S, IMPATIENT_S = 10.0, 0.2


@contextmanager
def served(device: Device, reply_timeout_s: float = PATIENT_S) -> Iterator[ModbusLink]:
    """A link to a server that hands every request, MBAP header included, to `device` and sends its answer."""

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
    """Header of the Messaging on TCP/IP guide: the request's transaction, protocol 0, length, unit."""
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
        served(device, IMPATIENT_S) as link,
        pytest.raises(DeviceTimeout, match="write holding registers 5 to 6"),
    ):
        link.write(5, [1, 2])
    assert len(requests) == 1


def test_a_read_is_repeated_once_after_silence():
    requests: list[bytes] = []

    def device(request: bytes) -> bytes:
        requests.append(request)
        return reply(request, bytes.fromhex("03 02 0007")) if len(requests) == 2 else b""

    with served(device, IMPATIENT_S) as link:
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
        served(lambda request: reply(request, bytes.fromhex(pdu)), IMPATIENT_S) as link,
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
        with served(device, IMPATIENT_S) as link, pytest.raises((DeviceTimeout, LinkLost)):
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
