"""Modbus servers of the box at a closed machine, and the faults of the box."""

from simulators.closed_machine.box import AnalogueBox
from simulators.wire.faults import CLOSED_MACHINE, FaultPanel
from simulators.wire.modbus import ModbusRtuServer, ModbusTcpServer
from simulators.wire.ports import Server, port_of


def box_faults(panel: FaultPanel, box: AnalogueBox | None) -> FaultPanel:
    """Return a panel with the faults of a box; switching a fault on changes `box`, if there is one."""
    if box is None:
        return panel

    def broken(on: bool) -> None:
        box.broken = on

    def overflown(on: bool) -> None:
        box.overflown = on

    panel.when("broken-sensor", lambda: broken(True), lambda: broken(False))
    panel.when("overflow", lambda: overflown(True), lambda: overflown(False))
    return panel


class _AnalogueBoxLine(Server):
    """Base class of the servers of an `AnalogueBox`. `AnalogueBoxServer` describes the parameters."""

    unit = 1

    def __init__(
        self, box: AnalogueBox, host: str | None = None, port: int = 0, faults: FaultPanel | None = None
    ) -> None:
        self.box = box
        self.faults = faults or box_faults(FaultPanel(CLOSED_MACHINE), box)
        self._port = port_of(self, host or self.default_host, port)

    def answer(self, unit: int, request: bytes) -> bytes:
        """Execute one protocol data unit and return the data unit of the answer."""
        if (code := self.faults.take("exception")) is not None:
            return bytes([request[0] | 0x80, int(code)])
        return self.box.answer(request)


class AnalogueBoxServer(_AnalogueBoxLine, ModbusTcpServer):
    """A Modbus TCP server of an `AnalogueBox`, by default on any free port and without faults."""


class AnalogueBoxRtuServer(_AnalogueBoxLine, ModbusRtuServer):
    """A Modbus RTU server of an `AnalogueBox`, on a pseudo-terminal or, with `host`, on a TCP port."""
