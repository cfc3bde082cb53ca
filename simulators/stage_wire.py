"""The rotation stage on a line: Zaber ASCII, protocol version 3, on a pseudo-terminal or a TCP port.

A message is ``/[address] [axis] [id|--] command[:LRC]`` and CR or LF; the answer
``@AA x [id] OK|RJ BUSY|IDLE FLAG|-- data[:LRC]`` and CR LF. Whoever sends an id or a checksum gets one back.
"""

import contextlib
import os
import re
import select
import socket
import threading
import tty
from collections.abc import Callable

from simulators.stage_device import RefusedError, StageDevice
from simulators.tcp_server import TcpServer

# The data value of a speed is microsteps/s times 1.6384, of an acceleration microsteps/s² times 1.6384e-4.
SPEED_UNIT = 1.6384
ACCELERATION_UNIT = 1.6384e-4
MESSAGE = re.compile(r"/(?:(?P<address>\d+)(?: +(?P<axis>\d+)(?: +(?P<id>\d+|--))?)?)? *(?P<command>[^:]*)$")
LINE_MAX = 128


def checksum(text: str) -> str:
    """LRC of what stands between the first character and the colon: two hexadecimal digits."""
    return f"{-sum(text.encode('ascii', 'replace')) & 0xFF:02X}"


class StageServer:
    """The stage's line on a pseudo-terminal.

    Parameters
    ----------
    device : StageDevice
    device_address : int
        The stage's own address; 0 and no address mean everybody.
    serial : int
        The serial number it reports.

    Attributes
    ----------
    address : str
        The real path of the terminal to open.
    """

    def __init__(self, device: StageDevice, *, device_address: int = 1, serial: int = 110001) -> None:
        self.device = device
        self.device_address = device_address
        self.serial = serial
        self._turn = threading.Lock()
        self._open()

    def _open(self) -> None:
        # our own descriptor of the far end stays open, so that a client may leave and come back
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.address = os.ttyname(self._far)
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name=f"stage {self.address}", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        buffer = b""
        while True:
            ready, _, _ = select.select([self._near, self._wake_read], [], [])
            if self._wake_read in ready:
                return
            buffer = self._consume(buffer + os.read(self._near, 4096), lambda r: os.write(self._near, r))

    def _consume(self, buffer: bytes, send: Callable[[bytes], object]) -> bytes:
        """Answer every complete line of `buffer` and return the rest."""
        *lines, rest = re.split(rb"[\r\n]", buffer)
        for line in lines:
            with self._turn:
                reply = self.answer(line)
            if reply:
                send(reply)
        return rest[-LINE_MAX:]

    def close(self) -> None:
        """Hang up and end the thread; harmless when repeated."""
        if not self._thread.is_alive():
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        for descriptor in (self._near, self._far, self._wake_read, self._wake_write):
            os.close(descriptor)

    def answer(self, line: bytes) -> bytes:
        """Act on one line and return the bytes to send back: none when it is damaged or for somebody else."""
        text = line.decode("ascii", "replace").strip()
        text, colon, lrc = text.partition(":")
        if colon and lrc.upper() != checksum(text[1:]):
            return b""
        message = MESSAGE.match(text)
        if message is None or int(message["address"] or 0) not in (0, self.device_address):
            return b""
        ok, data = self._execute(int(message["axis"] or 0), message["command"].split())
        if message["id"] == "--":
            return b""
        flags = self.device.flags
        number = f" {int(message['id']):02d}" if message["id"] else ""
        body = (
            f"{self.device_address:02d} {message['axis'] or 0}{number} {'OK' if ok else 'RJ'} "
            f"{'BUSY' if self.device.moving else 'IDLE'} {flags[0] if flags else '--'} {data}"
        )
        return f"@{body}{':' + checksum(body) if colon else ''}\r\n".encode("ascii")

    def _execute(self, axis: int, words: list[str]) -> tuple[bool, str]:
        if axis > 1:
            return False, "BADAXIS"
        try:
            return True, self._command(words)
        except RefusedError as reason:
            return False, str(reason)

    def _command(self, words: list[str]) -> str:
        device = self.device
        match words:
            case []:
                pass
            case ["home"]:
                device.home()
            case ["stop"]:
                device.stop()
            case ["move", "abs", value]:
                device.move_to(_integer(value))
            case ["warnings"]:
                return " ".join([f"{len(device.flags):02d}", *device.flags])
            case ["warnings", "clear"]:
                device.clear_flags()
                return "00"
            case ["driver", "enable"]:
                device.enable_driver()
            case ["get", name]:
                return self._get(name)
            case ["set", name, value]:
                self._set(name, _integer(value))
            case _:
                raise RefusedError("BADCOMMAND")
        return "0"

    def _get(self, name: str) -> str:
        device = self.device
        values: dict[str, Callable[[], object]] = {
            "pos": lambda: device.position,
            "maxspeed": lambda: round(device.speed_microsteps_s * SPEED_UNIT),
            "accel": lambda: round(device.acceleration_microsteps_s2 * ACCELERATION_UNIT),
            "limit.min": lambda: device.limit_min,
            "limit.max": lambda: device.limit_max,
            "resolution": lambda: 64,
            "deviceid": lambda: 50081,
            "system.serial": lambda: self.serial,
            "system.axiscount": lambda: 1,
            "version": lambda: "7.38",
            "version.build": lambda: 16451,
            "comm.address": lambda: self.device_address,
        }
        if name not in values:
            raise RefusedError("BADCOMMAND")
        return str(values[name]())

    def _set(self, name: str, value: int) -> None:
        device = self.device
        match name:
            case "maxspeed" if value > 0:
                device.speed_microsteps_s = value / SPEED_UNIT
            case "accel" if value > 0:
                device.acceleration_microsteps_s2 = value / ACCELERATION_UNIT
            case "limit.min" if value < device.limit_max:
                device.limit_min = value
            case "limit.max" if value > device.limit_min:
                device.limit_max = value
            case "maxspeed" | "accel" | "limit.min" | "limit.max":
                raise RefusedError("BADDATA")
            case _:
                raise RefusedError("BADCOMMAND")


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise RefusedError("BADDATA") from error


class StageTcpServer(StageServer):
    """The same line on a TCP port; `address` is ``host:port``."""

    def __init__(
        self,
        device: StageDevice,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        device_address: int = 1,
        serial: int = 110001,
    ) -> None:
        self._host, self._port = host, port
        super().__init__(device, device_address=device_address, serial=serial)

    def _open(self) -> None:
        self._server = TcpServer(self._converse, self._host, self._port)
        self.address = self._server.address

    def _converse(self, connection: socket.socket) -> None:
        buffer = b""
        while received := connection.recv(4096):
            buffer = self._consume(buffer + received, connection.sendall)

    def close(self) -> None:
        """Cut every client and end the threads; harmless when repeated."""
        with contextlib.suppress(OSError):
            self._server.close()
