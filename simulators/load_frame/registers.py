"""The registers of a load frame: the effect of each Modbus request, and the answer to each request.

Source: MODBUS Application Protocol Specification V1.1b3. A client must write a writable block completely, in
one request. A command is executed only if its sequence number is newer than the number of the last executed
command. A repeated or delayed request therefore has no effect.
"""

import math
import struct
import threading
from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.layout import Number, RegisterBlock, RegisterLayout
from simulators.load_frame.state import FaultCode, FrameReadings, MachineLimits, Refusal, RefusedError
from simulators.wire.faults import FaultPanel
from simulators.wire.modbus import WRITE_MANY

REVISION = 1
FIRMWARE = 0x0104
READ_HOLDING, READ_INPUT, WRITE_ONE = 3, 4, 6
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
READ_MAX, WRITE_MAX = 125, 123
LIMITS = ("load_min", "load_max", "displacement_min", "displacement_max", "speed_max", "load_rate_max")
"""The registers of the limits, in the order of the attributes of `MachineLimits`."""


class ExceptionReply(Exception):
    """Raised to answer a request with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"exception {code}")


class LoadFrameRegisters:
    """The registers of one load frame, shared by all servers of this load frame.

    `serial` is the serial number that the load frame reports.
    """

    def __init__(
        self, device: LoadFrameDevice, layout: RegisterLayout, serial: int, faults: FaultPanel
    ) -> None:
        self._device = device
        self._layout = layout
        self._serial = serial
        self._faults = faults
        self._turn = threading.Lock()
        self._forget()

    def _forget(self) -> None:
        self._power_ups = self._device.power_ups
        self._executed = 0
        self._result = 0
        self._command: dict[str, Number] = {}

    def answer(self, request: bytes) -> bytes:
        """Execute one protocol data unit (function code and data) and return the answer's data unit."""
        function = request[0]
        try:
            if (code := self._faults.take("exception")) is not None:
                raise ExceptionReply(int(code))
            with self._turn:
                if self._power_ups != self._device.power_ups:
                    self._forget()
                return self._execute(function, request[1:])
        except ExceptionReply as exception:
            return struct.pack(">BB", function | 0x80, exception.code)

    def _execute(self, function: int, data: bytes) -> bytes:
        if function in (READ_HOLDING, READ_INPUT):
            address, count = _unpack(">HH", data)
            if not 1 <= count <= min(READ_MAX, self._layout.request_max):
                raise ExceptionReply(ILLEGAL_VALUE)
            values = self._cut(self._table(function), address, count)
            return struct.pack(">BB", function, len(values)) + values
        if function == WRITE_ONE:
            (address,) = _unpack(">H", data[:2])
            self._write(address, data[2:])
            return struct.pack(">B", function) + data
        if function == WRITE_MANY:
            address, count, size = _unpack(">HHB", data[:5])
            most = min(WRITE_MAX, self._layout.request_max)
            if not 1 <= count <= most or size != 2 * count or len(data) != 5 + size:
                raise ExceptionReply(ILLEGAL_VALUE)
            self._write(address, data[5:])
            return struct.pack(">BHH", function, address, count)
        raise ExceptionReply(ILLEGAL_FUNCTION)

    def _table(self, function: int) -> list[RegisterBlock]:
        layout = self._layout
        if function == READ_INPUT:
            return [] if layout.one_table else layout.readable
        return layout.writable + (layout.readable if layout.one_table else [])

    def _cut(self, blocks: list[RegisterBlock], address: int, count: int) -> bytes:
        """Return `count` registers of one block. A request beyond the end of the block is refused."""
        for block in blocks:
            first = address - block.address
            if first >= 0 and first + count <= block.count:
                values = self._layout.encode(block, self._values(block))
                return values[2 * first : 2 * (first + count)]
        raise ExceptionReply(ILLEGAL_ADDRESS)

    def _values(self, block: RegisterBlock) -> dict[str, Number]:
        layout, device = self._layout, self._device
        if block is layout.state or block is layout.status:
            return self._state(device.read())
        if block is layout.identity:
            return {"serial": self._serial, "firmware": FIRMWARE}
        if block is layout.command or block is layout.setpoints:
            return self._command
        if block is layout.watchdog:
            return {"timeout": device.watchdog_s}
        if block is layout.heartbeat:
            return {"heartbeat": device.heartbeat}
        return dict(zip(LIMITS, astuple(device.limits), strict=True))

    def _state(self, readings: FrameReadings) -> dict[str, Number]:
        return {
            "revision": REVISION,
            "sample": readings.sample,
            "status": _status(self._layout.bits, readings),
            "fault": int(readings.fault),
            "executed": self._executed,
            "result": self._result,
            "load": readings.load_n,
            "displacement": readings.displacement_mm,
            "speed": readings.speed_mm_s,
            "set_speed": readings.set_speed_mm_s,
            "target": readings.target,
            "device_time_ms": round(readings.time_s * 1000),
        }

    def _write(self, address: int, data: bytes) -> None:
        layout = self._layout
        block = next((each for each in layout.writable if each.address == address), None)
        if block is None or 2 * block.count != len(data):
            raise ExceptionReply(ILLEGAL_ADDRESS)
        values = layout.decode(block, data)
        try:
            if block is layout.command:
                self._obey({**self._command, **values})
            elif block is layout.setpoints:
                self._command = {**self._command, **values}
            elif block is layout.limits:
                self._device.set_limits(MachineLimits(*(values[name] for name in LIMITS)))
            elif block is layout.watchdog:
                self._device.set_watchdog(values["timeout"])
            else:
                self._device.beat(int(values["heartbeat"]))
        except RefusedError as refusal:
            raise ExceptionReply(ILLEGAL_VALUE) from refusal

    def _obey(self, values: dict[str, Number]) -> None:
        sequence = int(values["sequence"])
        if not 0 < (sequence - self._executed) % 2**16 < 2**15:
            return
        self._command = values
        self._executed, self._result = sequence, 0
        device = self._device
        try:
            match self._layout.commands.get(int(values["command"])):
                case "hold":
                    device.hold()
                case "displacement":
                    device.go_to_displacement(values["displacement"], values["speed"])
                case "load":
                    device.go_to_load(values["load"], values["load_rate"])
                case "speed":
                    device.change_speed(values["speed"])
                case "tare":
                    device.tare()
                case _:
                    raise RefusedError(Refusal.UNKNOWN)
        except RefusedError as refusal:
            self._result = refusal.reason


def _status(bits: Mapping[str, int], readings: FrameReadings) -> int:
    true = {
        "ready": not readings.estop,
        "moving": readings.moving,
        "at_target": readings.at_target,
        "holding": readings.holding,
        "limit": readings.fault in (FaultCode.LOAD_LIMIT, FaultCode.DISPLACEMENT_LIMIT),
        "watchdog": readings.fault is FaultCode.WATCHDOG,
        "estop": readings.estop,
        "load_valid": math.isfinite(readings.load_n),
    }
    return sum(1 << place for name, place in bits.items() if true[name])


def _unpack(format: str, data: bytes) -> tuple[Any, ...]:
    try:
        return struct.unpack(format, data)
    except struct.error as error:
        raise ExceptionReply(ILLEGAL_VALUE) from error
