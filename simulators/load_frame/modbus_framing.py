"""Framing of Modbus requests: a header on TCP, and an address and a checksum on a serial line.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b; MODBUS over Serial Line Specification V1.02.
"""

import struct
from collections.abc import Iterator

from simulators.load_frame.registers import WRITE_MANY

HEADER = 7
ADU_MAX = 260
RTU_MAX = 256
SHORT_REQUESTS = {1, 2, 3, 4, 5, 6}
"""Modbus function codes whose requests are eight bytes long on a serial line."""


def cut_tcp(buffer: bytes) -> tuple[list[bytes], bytes]:
    """Return the complete messages in a buffer, and the remaining bytes.

    Raises
    ------
    ConnectionError
        If the bytes have no Modbus header. The connection must then be closed.
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
