"""The load frame on a network or a serial line: Modbus TCP, Modbus RTU, and RTU over TCP.

Written from the specification alone; `simulators.load_frame.layout` holds the registers.
"""

import struct

from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.layout import GENERIC, Layout
from simulators.load_frame.modbus_framing import HEADER, crc, cut_rtu, cut_tcp
from simulators.load_frame.registers import LoadFrameRegisters
from simulators.wire.faults import LOAD_FRAME, FaultPanel
from simulators.wire.ports import LOCALHOST, Server, port_of

TARGET_SILENT = 11
BROADCAST = 0
SERIAL = 220001


class _LoadFrameLine(Server):
    """What every line of a load frame has; the parameters are those of `LoadFrameServer`."""

    def __init__(
        self,
        device: LoadFrameDevice,
        unit: int,
        serial: int,
        layout: Layout,
        faults: FaultPanel | None,
        registers: LoadFrameRegisters | None,
    ) -> None:
        self.device = device
        self.unit = unit
        self.faults = faults or load_frame_faults(FaultPanel(LOAD_FRAME), device)
        self.registers = registers or LoadFrameRegisters(device, layout, serial, self.faults)

    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Act on one protocol data unit (function code and data) and return the answer's, or None."""
        return self.registers.answer(request)


class LoadFrameServer(_LoadFrameLine):
    """A load frame's Modbus TCP port.

    Parameters
    ----------
    device : LoadFrameDevice
    host : str
    port : int
        0 takes any free port.
    unit : int
        The unit identifier it answers to.
    serial : int
        The serial number it reports.
    layout : Layout
    faults : FaultPanel, optional
        One is made if none is given.
    registers : LoadFrameRegisters, optional
        The registers of another line to share; `serial` and `layout` are ignored then.
    """

    def __init__(
        self,
        device: LoadFrameDevice,
        host: str = LOCALHOST,
        port: int = 0,
        *,
        unit: int = 1,
        serial: int = SERIAL,
        layout: Layout = GENERIC,
        faults: FaultPanel | None = None,
        registers: LoadFrameRegisters | None = None,
    ) -> None:
        super().__init__(device, unit, serial, layout, faults, registers)
        self._port = port_of(self, host, port)

    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Act on one protocol data unit; a foreign unit is answered as by a gateway that cannot reach it."""
        if unit != self.unit:
            return struct.pack(">BB", request[0] | 0x80, TARGET_SILENT)
        return super().answer(unit, request)

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete messages in a buffer, and the rest."""
        return cut_tcp(buffer)

    def respond(self, message: bytes) -> bytes:
        """Act on one message and return the answer under the same transaction number."""
        transaction, _, _, unit = struct.unpack(">HHHB", message[:HEADER])
        reply = self.answer(unit, message[HEADER:])
        if reply is None:
            return b""
        return struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with another function code, as from a gateway that mixes up answers."""
        return reply[:HEADER] + bytes([reply[HEADER] ^ 0x40]) + reply[HEADER + 1 :]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with another unit's identifier."""
        return reply[: HEADER - 1] + bytes([reply[HEADER - 1] ^ 0x02]) + reply[HEADER:]


class LoadFrameRtuServer(_LoadFrameLine):
    """The same frame as Modbus RTU: on a pseudo-terminal, or at a host on TCP as a device server carries it.

    A damaged message, or one for another unit, gets no answer. A broadcast (unit 0) is carried out without an
    answer. The parameters are those of `LoadFrameServer`.
    """

    def __init__(
        self,
        device: LoadFrameDevice,
        host: str | None = None,
        port: int = 0,
        *,
        unit: int = 1,
        serial: int = SERIAL,
        layout: Layout = GENERIC,
        faults: FaultPanel | None = None,
        registers: LoadFrameRegisters | None = None,
    ) -> None:
        super().__init__(device, unit, serial, layout, faults, registers)
        self._port = port_of(self, host, port)

    def cut(self, buffer: bytes) -> tuple[list[bytes], bytes]:
        """Return the complete messages in a buffer, and the rest."""
        return cut_rtu(buffer)

    def respond(self, message: bytes) -> bytes:
        """Act on one message and return the answer, empty when it is for another unit or for all."""
        unit = message[0]
        if unit not in (self.unit, BROADCAST):
            return b""
        reply = self.answer(unit, message[1:-2])
        return b"" if reply is None or unit == BROADCAST else _sealed(bytes([unit]) + reply)

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with one bit flipped, which its checksum shows."""
        return reply[:2] + bytes([reply[2] ^ 0x10]) + reply[3:]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with the address of another unit of the line."""
        return _sealed(bytes([reply[0] ^ 0x02]) + reply[1:-2])


def _sealed(message: bytes) -> bytes:
    return message + crc(message)
