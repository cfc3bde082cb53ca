"""A module with contacts and analogue inputs, and its Modbus servers.

Source: MODBUS Application Protocol Specification V1.1b3, chapters 6.1 to 6.4. No code is shared with drivers.
"""

import struct
import threading

from simulators.wire.faults import INTERLOCK, FaultPanel
from simulators.wire.modbus import ModbusRtuServer, ModbusTcpServer
from simulators.wire.ports import Server, port_of

_COILS, _DISCRETE, _HOLDING, _INPUT = 1, 2, 3, 4
_ILLEGAL_FUNCTION, _ILLEGAL_ADDRESS, _ILLEGAL_VALUE = 1, 2, 3


class InputModule:
    """The state of a module with eight contacts and eight analogue inputs. First all contacts are closed."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._contacts = [True] * 8
        self._registers = [0] * 8

    def set_contact(self, number: int, *, closed: bool) -> None:
        """Close or open a contact."""
        with self._lock:
            self._contacts[number] = closed

    def set_register(self, number: int, value: int) -> None:
        """Set the raw value of an analogue input, from -32768 to 65535."""
        with self._lock:
            self._registers[number] = value % 2**16

    def answer(self, request: bytes) -> bytes:
        """Execute one protocol data unit and return the data unit of the answer."""
        function = request[0]
        with self._lock:
            tables: dict[int, list[bool] | list[int]] = {
                _COILS: self._contacts,
                _DISCRETE: self._contacts,
                _HOLDING: self._registers,
                _INPUT: self._registers,
            }
            values = tables.get(function)
            if values is None:
                return bytes([function | 0x80, _ILLEGAL_FUNCTION])
            if len(request) != 5:
                return bytes([function | 0x80, _ILLEGAL_VALUE])
            first, count = struct.unpack(">HH", request[1:])
            if count < 1 or first + count > len(values):
                return bytes([function | 0x80, _ILLEGAL_ADDRESS])
            chosen = values[first : first + count]
        if function in (_HOLDING, _INPUT):
            return bytes([function, 2 * count]) + struct.pack(f">{count}H", *chosen)
        packed = bytearray((count + 7) // 8)
        for place, closed in enumerate(chosen):
            packed[place // 8] |= int(closed) << place % 8
        return bytes([function, len(packed)]) + bytes(packed)


class _InputModuleLine(Server):
    """Base class of the servers of an `InputModule`. `InputModuleServer` describes the parameters."""

    unit = 1

    def __init__(
        self, module: InputModule, host: str | None = None, port: int = 0, faults: FaultPanel | None = None
    ) -> None:
        self.module = module
        self.faults = faults or FaultPanel(INTERLOCK)
        self._port = port_of(self, host or self.default_host, port)

    def answer(self, unit: int, request: bytes) -> bytes:
        """Execute one protocol data unit and return the data unit of the answer."""
        if (code := self.faults.take("exception")) is not None:
            return bytes([request[0] | 0x80, int(code)])
        return self.module.answer(request)


class InputModuleServer(_InputModuleLine, ModbusTcpServer):
    """A Modbus TCP server of an `InputModule`, by default on any free port and without faults."""


class InputModuleRtuServer(_InputModuleLine, ModbusRtuServer):
    """A Modbus RTU server of an `InputModule`, on a pseudo-terminal or, with `host`, on a TCP port."""
