"""Servers of a simulated load frame for Modbus TCP, Modbus RTU, and Modbus RTU over TCP.

This module follows the Modbus specification only and shares no code with the drivers. The registers are in
`simulators.load_frame.layout`.
"""

import struct

from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.layout import GENERIC, RegisterLayout
from simulators.load_frame.registers import LoadFrameRegisters
from simulators.wire.faults import LOAD_FRAME, FaultPanel
from simulators.wire.modbus import ModbusRtuServer, ModbusTcpServer
from simulators.wire.ports import Server, port_of

TARGET_SILENT = 11
SERIAL = 220001


class _LoadFrameLine(Server):
    """Base class of a load frame's servers. `LoadFrameServer` describes the parameters."""

    def __init__(
        self,
        device: LoadFrameDevice,
        host: str | None = None,
        port: int = 0,
        *,
        unit: int = 1,
        serial: int = SERIAL,
        layout: RegisterLayout = GENERIC,
        faults: FaultPanel | None = None,
        registers: LoadFrameRegisters | None = None,
    ) -> None:
        self.device = device
        self.unit = unit
        self.faults = faults or load_frame_faults(FaultPanel(LOAD_FRAME), device)
        self.registers = registers or LoadFrameRegisters(device, layout, serial, self.faults)
        self._port = port_of(self, host or self.default_host, port)

    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Execute one Modbus protocol data unit; return the data unit of the answer, or None."""
        return self.registers.answer(request)


class LoadFrameServer(_LoadFrameLine, ModbusTcpServer):
    """A Modbus TCP server of a simulated load frame.

    Parameters
    ----------
    device : LoadFrameDevice
    host : str, optional
        Default: the address 127.0.0.1.
    port : int
        The TCP port; 0 takes any free port.
    unit : int
        The server's unit identifier.
    serial : int
        The serial number that the load frame reports.
    layout : RegisterLayout
    faults : FaultPanel, optional
        The faults of the load frame. Default: a new panel.
    registers : LoadFrameRegisters, optional
        Registers to share with another server of the same load frame. With shared registers, `serial` and
        `layout` have no effect.
    """

    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Execute one protocol data unit.

        As a gateway does, the server answers a request for another unit with Modbus exception 11.
        """
        if unit != self.unit:
            return struct.pack(">BB", request[0] | 0x80, TARGET_SILENT)
        return super().answer(unit, request)


class LoadFrameRtuServer(_LoadFrameLine, ModbusRtuServer):
    """A Modbus RTU server of a simulated load frame, on a pseudo-terminal or, with `host`, on a TCP port.

    The server does not answer damaged messages or messages for other units. A broadcast (unit 0) is executed
    without an answer. `LoadFrameServer` describes the parameters.
    """
