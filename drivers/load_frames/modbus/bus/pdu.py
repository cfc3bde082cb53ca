"""Modbus requests and the check of their answers: protocol data units, without unit and checksum.

Source: MODBUS Application Protocol Specification V1.1b3, chapters 6.3, 6.4, 6.6, 6.12 and 7.

Only this module uses pymodbus, to write requests and checksums. The driver checks the answers itself, because
pymodbus accepts wrong functions and lengths. The driver also waits itself, because a stop must be able to end
the wait.
"""

import struct
from dataclasses import dataclass

from pymodbus.framer import FramerRTU
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
EXCEPTION_BIT = 0x80
# Answers of a gateway itself: the device behind it did not answer, but may have executed the request.
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
    """An answer that does not belong to the request.

    Parameters
    ----------
    expected, got : str
    """

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
    """A request to a device.

    Attributes
    ----------
    pdu : bytes
        Function code and data.
    step : str
        The request in words.
    """

    pdu: bytes
    step: str

    @property
    def function(self) -> int:
        """The function code."""
        return self.pdu[0]

    def registers(self, answer: bytes) -> list[int]:
        """Return the registers in the answer; none in the acknowledgement of a write.

        Raises
        ------
        ExceptionAnswerError
            If the device refused.
        ForeignAnswerError
            If function, length or echo do not match the request.
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
        if answer != self.pdu[:5]:
            raise ForeignAnswerError(f"the echo {shown(self.pdu[:5])}", shown(answer))
        return []


def read_request(table: str, address: int, count: int) -> Request:
    """Ask for `count` registers of the `input` or `holding` table."""
    kind = ReadInputRegistersRequest if table == "input" else ReadHoldingRegistersRequest
    step = f"read {table} registers {address} to {address + count - 1}"
    return Request(_encoded(kind(address=address, count=count)), step)


def write_request(address: int, words: list[int]) -> Request:
    """Write holding registers."""
    step = f"write holding registers {address} to {address + len(words) - 1}"
    return Request(_encoded(WriteMultipleRegistersRequest(address=address, registers=words)), step)


def write_one_request(address: int, word: int) -> Request:
    """Write one holding register by function 6, which every device has."""
    request = WriteSingleRegisterRequest(address=address, registers=[word])
    return Request(_encoded(request), f"write holding register {address}")


def shown(data: bytes) -> str:
    """Return bytes in readable form for a message; only the first if there are too many."""
    text = data[:SHOWN_MAX].hex(" ")
    return text if len(data) <= SHOWN_MAX else f"{text} … ({len(data)} bytes)"


def crc(data: bytes) -> bytes:
    """Return the cyclic redundancy check of a serial frame, low byte first."""
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


def _encoded(request: ModbusPDU) -> bytes:
    return bytes([request.function_code]) + request.encode()
