"""The load frame on a network: Modbus TCP, written from the specification alone.

Sources: MODBUS Application Protocol Specification V1.1b3, MODBUS Messaging on TCP/IP Guide V1.0b.
The registers, all 32-bit values with the more significant word first (ABCD):

==============  ===========================================================================================
input 0–17      map revision u16, sample u32, status u16, fault u16, executed sequence u16, result u16,
                spare u16, load f32 N, displacement f32 mm, speed f32 mm/s, target f32, time u32 ms
input 32–34     serial number u32, firmware u16 (1.4 is 0x0104)
holding 0–9     command u16 (1 hold, 2 go to displacement, 3 go to load, 4 tare), displacement f32 mm,
                speed f32 mm/s, load f32 N, load rate f32 N/s, sequence u16
holding 32–43   limits f32: load min, load max N, displacement min, max mm, speed max mm/s,
                load rate max N/s
holding 64–65   watchdog time f32 s, 0 is off
holding 66      heartbeat u16
==============  ===========================================================================================

A holding block is written whole, in one request. A command is executed when its sequence number is newer than
the last one executed: the same request twice, or one overtaken by another, does nothing.
"""

import math
import socket
import struct
import threading
from typing import Any

from simulators.frame_device import FrameDevice
from simulators.frame_state import Fault, Limits, Readings, Refusal, RefusedError
from simulators.tcp_server import TcpServer

MAP_REVISION = 1
FIRMWARE = 0x0104
STATE, IDENTITY = 0, 32
COMMAND, LIMITS, WATCHDOG, HEARTBEAT = 0, 32, 64, 66
STATE_FORMAT = ">HIHHHHHffffI"
COMMAND_FORMAT = ">HffffH"
HOLD, GO_TO_DISPLACEMENT, GO_TO_LOAD, TARE = 1, 2, 3, 4
READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, TARGET_SILENT = 1, 2, 3, 11
READ_MAX, WRITE_MAX = 125, 123


class ExceptionReply(Exception):
    """The request is answered with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"exception {code}")


class FrameServer:
    """A load frame's Modbus TCP port.

    Parameters
    ----------
    device : FrameDevice
    host : str
    port : int
        0 takes any free port.
    unit : int
        The unit identifier it answers to.
    serial : int
        The serial number it reports.

    Attributes
    ----------
    address : str
        ``host:port``.
    """

    def __init__(
        self,
        device: FrameDevice,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        unit: int = 1,
        serial: int = 220001,
    ) -> None:
        self.device = device
        self.unit = unit
        self.serial = serial
        self._turn = threading.Lock()
        self._executed = 0
        self._result = 0
        self._command = bytes(struct.calcsize(COMMAND_FORMAT))
        self._server = TcpServer(self._converse, host, port)
        self.address = self._server.address

    def drop_clients(self) -> None:
        """Cut every connection; new ones are accepted."""
        self._server.drop_clients()

    def close(self) -> None:
        """Stop serving; harmless when repeated."""
        self._server.close()

    def _converse(self, connection: socket.socket) -> None:
        with connection.makefile("rb") as stream:
            while len(header := stream.read(7)) == 7:
                transaction, protocol, length, unit = struct.unpack(">HHHB", header)
                if protocol != 0 or not 2 <= length <= 254:
                    return
                request = stream.read(length - 1)
                if len(request) < length - 1:
                    return
                reply = self.answer(unit, request)
                if reply is not None:
                    connection.sendall(struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply)

    def answer(self, unit: int, request: bytes) -> bytes | None:
        """Act on one protocol data unit (function code and data) and return the answer's, or None."""
        function = request[0]
        try:
            with self._turn:
                return self._execute(unit, function, request[1:])
        except ExceptionReply as exception:
            return struct.pack(">BB", function | 0x80, exception.code)

    def _execute(self, unit: int, function: int, data: bytes) -> bytes:
        if unit != self.unit:
            raise ExceptionReply(TARGET_SILENT)
        if function in (READ_HOLDING, READ_INPUT):
            address, count = _unpack(">HH", data)
            if not 1 <= count <= READ_MAX:
                raise ExceptionReply(ILLEGAL_VALUE)
            blocks = self._input() if function == READ_INPUT else self._holding()
            values = _cut(blocks, address, count)
            return struct.pack(">BB", function, len(values)) + values
        if function == WRITE_ONE:
            (address,) = _unpack(">H", data[:2])
            self._write(address, data[2:])
            return struct.pack(">B", function) + data
        if function == WRITE_MANY:
            address, count, size = _unpack(">HHB", data[:5])
            if not 1 <= count <= WRITE_MAX or size != 2 * count or len(data) != 5 + size:
                raise ExceptionReply(ILLEGAL_VALUE)
            self._write(address, data[5:])
            return struct.pack(">BHH", function, address, count)
        raise ExceptionReply(ILLEGAL_FUNCTION)

    def _input(self) -> dict[int, bytes]:
        readings = self.device.read()
        state = struct.pack(
            STATE_FORMAT,
            MAP_REVISION,
            readings.sample % 2**32,
            _status(readings),
            readings.fault,
            self._executed,
            self._result,
            0,
            readings.load_n,
            readings.displacement_mm,
            readings.speed_mm_s,
            readings.target,
            round(readings.time_s * 1000) % 2**32,
        )
        return {STATE: state, IDENTITY: struct.pack(">IH", self.serial, FIRMWARE)}

    def _holding(self) -> dict[int, bytes]:
        limits = self.device.limits
        return {
            COMMAND: self._command,
            LIMITS: struct.pack(
                ">6f",
                limits.load_min_n,
                limits.load_max_n,
                limits.displacement_min_mm,
                limits.displacement_max_mm,
                limits.speed_max_mm_s,
                limits.load_rate_max_n_s,
            ),
            WATCHDOG: struct.pack(">f", self.device.watchdog_s),
            HEARTBEAT: struct.pack(">H", self.device.heartbeat),
        }

    def _write(self, address: int, values: bytes) -> None:
        block = self._holding().get(address)
        if block is None or len(block) != len(values):
            raise ExceptionReply(ILLEGAL_ADDRESS)
        try:
            if address == COMMAND:
                self._obey(values)
            elif address == LIMITS:
                self.device.set_limits(Limits(*_unpack(">6f", values)))
            elif address == WATCHDOG:
                self.device.set_watchdog(*_unpack(">f", values))
            else:
                self.device.beat(*_unpack(">H", values))
        except RefusedError as refusal:
            raise ExceptionReply(ILLEGAL_VALUE) from refusal

    def _obey(self, values: bytes) -> None:
        command, displacement_mm, speed_mm_s, load_n, rate_n_s, sequence = _unpack(COMMAND_FORMAT, values)
        if not 0 < (sequence - self._executed) % 2**16 < 2**15:
            return
        self._command = values
        self._executed, self._result = sequence, 0
        try:
            if command == HOLD:
                self.device.hold()
            elif command == GO_TO_DISPLACEMENT:
                self.device.go_to_displacement(displacement_mm, speed_mm_s)
            elif command == GO_TO_LOAD:
                self.device.go_to_load(load_n, rate_n_s)
            elif command == TARE:
                self.device.tare()
            else:
                raise RefusedError(Refusal.UNKNOWN)
        except RefusedError as refusal:
            self._result = refusal.reason


def _status(readings: Readings) -> int:
    """Status bits from 0: ready, moving, at target, hold, limit hit, watchdog tripped, e-stop, load valid."""
    bits = (
        not readings.estop,
        readings.moving,
        readings.at_target,
        readings.holding,
        readings.fault in (Fault.LOAD_LIMIT, Fault.DISPLACEMENT_LIMIT),
        readings.fault is Fault.WATCHDOG,
        readings.estop,
        math.isfinite(readings.load_n),
    )
    return sum(1 << position for position, bit in enumerate(bits) if bit)


def _cut(blocks: dict[int, bytes], address: int, count: int) -> bytes:
    """Return `count` registers from inside one block; a request that leaves it is refused."""
    for start, block in blocks.items():
        first = 2 * (address - start)
        if first >= 0 and first + 2 * count <= len(block):
            return block[first : first + 2 * count]
    raise ExceptionReply(ILLEGAL_ADDRESS)


def _unpack(format: str, data: bytes) -> tuple[Any, ...]:
    try:
        return struct.unpack(format, data)
    except struct.error as error:
        raise ExceptionReply(ILLEGAL_VALUE) from error
