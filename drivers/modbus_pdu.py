"""Modbus requests, and whether an answer belongs to one: protocol data units, without unit and checksum.

Source: MODBUS Application Protocol Specification V1.1b3, chapters 6.3, 6.4, 6.6, 6.12 and 7.
"""

import struct
from dataclasses import dataclass

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
EXCEPTION_BIT = 0x80
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
    """What is asked of a device.

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
            If function, length or what is echoed is not the request's.
        """
        if len(answer) == 2 and answer[0] == self.function | EXCEPTION_BIT:
            raise ExceptionAnswerError(answer[1])
        if not answer or answer[0] != self.function:
            got = f"one to function {answer[0]}" if answer else "an empty one"
            raise ForeignAnswerError(f"an answer to function {self.function}", got)
        if self.function in (READ_HOLDING, READ_INPUT):
            (count,) = struct.unpack(">H", self.pdu[3:5])
            if len(answer) != 2 + 2 * count or answer[1] != 2 * count:
                raise ForeignAnswerError(f"{count} registers", f"{(len(answer) - 2) / 2:g}")
            return list(struct.unpack(f">{count}H", answer[2:]))
        if answer != self.pdu[:5]:
            raise ForeignAnswerError(f"the echo {self.pdu[:5].hex(' ')}", answer.hex(" "))
        return []


def read_request(table: str, address: int, count: int) -> Request:
    """Ask for `count` registers of the `input` or `holding` table."""
    function = READ_INPUT if table == "input" else READ_HOLDING
    step = f"read {table} registers {address} to {address + count - 1}"
    return Request(struct.pack(">BHH", function, address, count), step)


def write_request(address: int, words: list[int]) -> Request:
    """Write holding registers."""
    head = struct.pack(">BHHB", WRITE_MANY, address, len(words), 2 * len(words))
    step = f"write holding registers {address} to {address + len(words) - 1}"
    return Request(head + struct.pack(f">{len(words)}H", *words), step)


def write_one_request(address: int, word: int) -> Request:
    """Write one holding register by the function that every device has."""
    return Request(struct.pack(">BHH", WRITE_ONE, address, word), f"write holding register {address}")
