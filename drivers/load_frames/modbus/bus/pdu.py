"""Build Modbus requests and check the answers.

Requests and answers are protocol data units here: the function code and the data, without the address of the
device and without a checksum. The function `crc` computes the checksum of a message on a serial line.

Source: MODBUS Application Protocol Specification V1.1b3, chapters 6.1 to 6.6, 6.12 and 7.

Only this module uses pymodbus, to encode requests and checksums. This module checks the answers without
pymodbus, because pymodbus accepts answers with a wrong function or length. The driver also waits for answers
without pymodbus, because a stop must be able to end the wait.
"""

import struct
from dataclasses import dataclass

from pymodbus.framer import FramerRTU
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadDiscreteInputsRequest, WriteSingleCoilRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

READ_COILS, READ_DISCRETE = 1, 2
READ_HOLDING, READ_INPUT, WRITE_COIL, WRITE_ONE, WRITE_MANY = 3, 4, 5, 6, 16
WRITES = (WRITE_COIL, WRITE_ONE, WRITE_MANY)
EXCEPTION_BIT = 0x80
# Exception codes of a gateway. The device behind it did not answer, but may have executed the request.
NOBODY = (10, 11)
SHOWN_MAX = 40
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge only",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not answer",
}


class ForeignAnswerError(ValueError):
    """An answer that does not belong to the request."""

    def __init__(self, expected: str, got: str) -> None:
        self.expected = expected
        self.got = got
        super().__init__(f"expected {expected}, got {got}")


class ExceptionAnswerError(Exception):
    """The device refused the request with an exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"exception {code} ({EXCEPTIONS.get(code, 'unknown')})")


@dataclass(frozen=True)
class Request:
    """A request to a device."""

    pdu: bytes  # protocol data unit: function code and data
    step: str  # description of the request, used in error messages

    @property
    def function(self) -> int:
        """The Modbus function code of the request."""
        return self.pdu[0]

    def registers(self, answer: bytes) -> list[int]:
        """Check an answer and return its registers. The answer to a write request has no registers.

        Raise `ExceptionAnswerError` if the device refused the request, and `ForeignAnswerError` if the
        function, the length or the echoed data do not match the request.
        """
        if len(answer) == 2 and answer[0] == self.function | EXCEPTION_BIT:
            raise ExceptionAnswerError(answer[1])
        if not answer or answer[0] != self.function:
            got = f"one to function {answer[0]}" if answer else "an empty one"
            raise ForeignAnswerError(f"an answer to function {self.function}", got)
        if self.function in (READ_HOLDING, READ_INPUT):
            (count,) = struct.unpack(">H", self.pdu[3:5])
            if len(answer) != 2 + 2 * count or answer[1] != 2 * count:
                raise ForeignAnswerError(f"{count} registers", shown(answer))
            return list(struct.unpack(f">{count}H", answer[2:]))
        if self.function in (READ_COILS, READ_DISCRETE):
            (count,) = struct.unpack(">H", self.pdu[3:5])
            size = (count + 7) // 8
            if len(answer) != 2 + size or answer[1] != size:
                raise ForeignAnswerError(f"{count} bits", shown(answer))
            return [answer[2 + place // 8] >> place % 8 & 1 for place in range(count)]
        if answer != self.pdu[:5]:
            raise ForeignAnswerError(f"the echo {shown(self.pdu[:5])}", shown(answer))
        return []


def read_request(table: str, address: int, count: int) -> Request:
    """Return a request for `count` registers or bits of a table, starting at `address`.

    The table is `input` or `holding` for registers, `discrete` or `coil` for bits.
    """
    kind = _READ[table]
    what = f"{table} registers" if table in ("input", "holding") else f"{table} bits"
    step = f"read {what} {address} to {address + count - 1}"
    return Request(_encoded(kind(address=address, count=count)), step)


def fewer_registers(request: bytes, count: int) -> bytes:
    """Return a request for the first `count` registers of another request."""
    return request[:3] + struct.pack(">H", count)


def known_answer(request: bytes, words: list[int]) -> bytes:
    """Return the answer that a device gives to a request if the requested registers contain `words`."""
    return bytes([request[0], 2 * len(words)]) + struct.pack(f">{len(words)}H", *words)


_READ = {
    "input": ReadInputRegistersRequest,
    "holding": ReadHoldingRegistersRequest,
    "discrete": ReadDiscreteInputsRequest,
    "coil": ReadCoilsRequest,
}


def write_request(address: int, words: list[int]) -> Request:
    """Return a request that writes `words` to holding registers, starting at `address`."""
    step = f"write holding registers {address} to {address + len(words) - 1}"
    return Request(_encoded(WriteMultipleRegistersRequest(address=address, registers=words)), step)


def write_one_request(address: int, word: int) -> Request:
    """Return a request that writes one holding register with Modbus function 6."""
    request = WriteSingleRegisterRequest(address=address, registers=[word])
    return Request(_encoded(request), f"write holding register {address}")


def write_coil_request(number: int, on: bool) -> Request:
    """Return a request that switches one coil on or off, with Modbus function 5."""
    request = WriteSingleCoilRequest(address=number, bits=[on])
    return Request(_encoded(request), f"switch coil {number} {'on' if on else 'off'}")


def shown(data: bytes) -> str:
    """Return bytes as hexadecimal text for an error message. A long text is cut off."""
    text = data[:SHOWN_MAX].hex(" ")
    return text if len(data) <= SHOWN_MAX else f"{text} … ({len(data)} bytes)"


def crc(data: bytes) -> bytes:
    """Return the checksum (CRC) of a serial frame, low byte first."""
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


def _encoded(request: ModbusPDU) -> bytes:
    return bytes([request.function_code]) + request.encode()
