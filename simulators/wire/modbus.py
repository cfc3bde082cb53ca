"""Framing of Modbus requests: a header on TCP, and an address and a checksum on a serial line.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b; MODBUS over Serial Line Specification V1.02.
"""

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator

from simulators.wire.ports import LOCALHOST, Server

WRITE_MANY = 16
"""Modbus function code of a request that writes several registers."""
BROADCAST = 0
"""Address of a broadcast: a serial message to all units, which no unit answers."""
HEADER = 7
ADU_MAX = 260
RTU_MAX = 256
SHORT_REQUESTS = {1, 2, 3, 4, 5, 6}
"""Modbus function codes whose requests are eight bytes long on a serial line."""


class ModbusTcpServer(Server, ABC):
    """Modbus TCP for a device whose `answer` executes a protocol data unit (function code and data)."""

    default_host = LOCALHOST

    @abstractmethod
    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Execute a data unit that a client sent to a unit; return the answer's data unit, or None."""

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete messages in a buffer, and the remaining bytes."""
        return cut_tcp(buffer)

    def respond(self, message: bytes) -> bytes:
        """Execute one message and return the answer with the same transaction number."""
        transaction, _, _, unit = struct.unpack(">HHHB", message[:HEADER])
        reply = self.answer(unit, message[HEADER:])
        if reply is None:
            return b""
        return struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with a wrong function code, as from a gateway that confuses answers."""
        return reply[:HEADER] + bytes([reply[HEADER] ^ 0x40]) + reply[HEADER + 1 :]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with the identifier of another unit."""
        return reply[: HEADER - 1] + bytes([reply[HEADER - 1] ^ 0x02]) + reply[HEADER:]


class ModbusRtuServer(Server, ABC):
    """Modbus RTU for a device whose `answer` executes a protocol data unit.

    The server does not answer damaged messages or messages for other units. A broadcast is executed without
    an answer.
    """

    unit: int  # the address of the device on the serial line

    @abstractmethod
    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Execute a data unit for this device or for all devices; return the answer's data unit, or None."""

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete messages in a buffer, and the remaining bytes."""
        return cut_rtu(buffer)

    def respond(self, message: bytes) -> bytes:
        """Execute one message and return the answer; empty for a broadcast or another unit's message."""
        unit = message[0]
        if unit not in (self.unit, BROADCAST):
            return b""
        reply = self.answer(unit, message[1:-2])
        return b"" if reply is None or unit == BROADCAST else _sealed(bytes([unit]) + reply)

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with one bit flipped, so that its checksum is wrong."""
        return reply[:2] + bytes([reply[2] ^ 0x10]) + reply[3:]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with the address of another unit and a correct checksum."""
        return _sealed(bytes([reply[0] ^ 0x02]) + reply[1:-2])


def cut_tcp(buffer: bytes) -> tuple[list[bytes], bytes]:
    """Return the complete messages in a buffer, and the remaining bytes.

    Raise `ConnectionError` if the bytes have no Modbus header. The connection must then be closed.
    """
    messages = []
    while len(buffer) >= HEADER:
        _, protocol, length = struct.unpack(">HHH", buffer[:6])
        if protocol != 0 or not 2 <= length <= ADU_MAX - 6:
            raise ConnectionError("no Modbus header")
        if len(buffer) < 6 + length:
            break
        messages.append(buffer[: 6 + length])
        buffer = buffer[6 + length :]
    return messages, buffer


def cut_rtu(buffer: bytes) -> tuple[list[bytes], bytes]:
    """Return the complete requests in a buffer, and the remaining bytes.

    On a real serial line, a pause separates two messages. A pseudo-terminal does not preserve pauses, so this
    function uses the checksum to find requests. Bytes before a valid request are skipped.
    """
    messages = []
    while (found := next(_requests(buffer), None)) is not None:
        start, end = found
        messages.append(buffer[start:end])
        buffer = buffer[end:]
    return messages, buffer[-RTU_MAX:]


def _requests(buffer: bytes) -> Iterator[tuple[int, int]]:
    """Yield start and end of every slice of a buffer that is a complete request."""
    for start in range(len(buffer) - 3):
        function = buffer[start + 1]
        if function in SHORT_REQUESTS:
            end = start + 8
        elif function == WRITE_MANY:
            end = start + 9 + buffer[start + 6] if len(buffer) > start + 6 else len(buffer) + 1
        else:
            end = len(buffer)
        if end <= min(len(buffer), start + RTU_MAX) and crc(buffer[start : end - 2]) == buffer[end - 2 : end]:
            yield start, end


def crc(data: bytes) -> bytes:
    """Return the CRC-16 checksum with the reflected polynomial 0xA001, low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


def _sealed(message: bytes) -> bytes:
    return message + crc(message)
