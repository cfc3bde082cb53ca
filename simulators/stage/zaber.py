"""A rotation stage as a server of the protocol Zaber ASCII 3, on a pseudo-terminal or a TCP port.

A message is ``/[address] [axis] [id|--] command[:LRC]`` and CR or LF. The answer is
``@AA x [id] OK|RJ BUSY|IDLE FLAG|-- data[:LRC]`` and CR LF. If a message has an id or a checksum, the answer
has an id or a checksum too.
Source: Zaber ASCII Protocol Manual (https://www.zaber.com/protocol-manual).
"""

import re

from simulators.stage.device import StageDevice, StageRefusedError
from simulators.stage.faults import stage_faults
from simulators.stage.zaber_settings import ACCELERATION_UNIT, SPEED_UNIT, ZaberDeviceSettings
from simulators.wire.faults import STAGE, FaultPanel
from simulators.wire.ports import LineServer, port_of

MESSAGE = re.compile(r"/(?:(?P<address>\d+)(?: +(?P<axis>\d+)(?: +(?P<id>\d+|--))?)?)? *(?P<command>[^:]*)$")
AXES = 1
NUMBER_MAX = 2**63 - 1


def checksum(text: str) -> str:
    """Return the LRC checksum, two hexadecimal digits, of the text between first character and colon."""
    return f"{-sum(text.encode('ascii', 'replace')) & 0xFF:02X}"


class ZaberServer(LineServer):
    """A server for one stage, on a pseudo-terminal or on TCP.

    Parameters
    ----------
    device : StageDevice
    host : str, optional
        Address at which the server listens on TCP. Default: a pseudo-terminal instead of TCP.
    port : int
        The TCP port; 0 takes any free port.
    device_address : int
        The Zaber address of the stage. Messages with address 0 or without an address are for all devices.
    serial : int
        The serial number that the stage reports.
    faults : FaultPanel, optional
        The faults of the stage. Default: a new panel.
    """

    line_max = 128

    def __init__(
        self,
        device: StageDevice,
        *,
        host: str | None = None,
        port: int = 0,
        device_address: int = 1,
        serial: int = 110001,
        faults: FaultPanel | None = None,
    ) -> None:
        self.device = device
        self.settings = ZaberDeviceSettings(device, device_address, serial)
        self.faults = faults or stage_faults(FaultPanel(STAGE), device)
        super().__init__()
        self._port = port_of(self, host, port)

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with one bit flipped; a client detects this if the answer has a checksum."""
        return _changed(reply, len(reply) // 2, reply[len(reply) // 2] ^ 0x04)

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer with the address of the next device in the chain."""
        body, colon, _ = reply.decode("ascii").strip().partition(":")
        body = f"{self.settings.address + 1:02d}{body[3:]}"
        return f"@{body}{':' + checksum(body) if colon else ''}\r\n".encode("ascii")

    def answer(self, line: bytes) -> bytes:
        """Execute one line and return the answer; empty if the line is damaged or for another device."""
        text = line.decode("ascii", "replace").strip()
        text, colon, lrc = text.partition(":")
        if colon and lrc.upper() != checksum(text[1:]):
            return b""
        message = MESSAGE.match(text)
        if message is None or int(message["address"] or 0) not in (0, self.settings.address):
            return b""
        ok, data = self._execute(int(message["axis"] or 0), message["command"].split())
        if message["id"] == "--":
            return b""
        flags = self.device.flags
        number = f" {int(message['id']):02d}" if message["id"] else ""
        body = (
            f"{self.settings.address:02d} {message['axis'] or 0}{number} {'OK' if ok else 'RJ'} "
            f"{'BUSY' if self.device.moving else 'IDLE'} {flags[0] if flags else '--'} {data}"
        )
        with_checksum = colon or self.settings.always_checksum
        return f"@{body}{':' + checksum(body) if with_checksum else ''}\r\n".encode("ascii")

    def _execute(self, axis: int, words: list[str]) -> tuple[bool, str]:
        if axis > AXES:
            return False, "BADAXIS"
        if (reason := self.faults.take("reject")) is not None:
            return False, reason
        try:
            return True, self._command(axis, words)
        except StageRefusedError as refusal:
            return False, str(refusal)

    def _command(self, axis: int, words: list[str]) -> str:
        device = self.device
        match words:
            case []:
                pass
            case ["home"]:
                device.home()
            case ["stop"]:
                device.stop()
            case ["estop"] if device.moving:
                device.fail("NI")
            case ["estop"]:
                pass
            case ["move", *rest]:
                self._move(rest)
            case ["warnings"]:
                return " ".join([f"{len(device.flags):02d}", *device.flags])
            case ["warnings", "clear"]:
                device.clear_flags()
                return "00"
            case ["driver", "enable"]:
                device.enable_driver()
            case ["driver", "disable"]:
                device.disable_driver()
            case ["get", name]:
                return self.settings.get(axis, name)
            case ["set", name, value]:
                self.settings.set(axis, name, _integer(value))
            case ["tools", "parking", "park"]:
                device.park()
            case ["tools", "parking", "unpark"]:
                device.parked = False
            case ["renumber", value] if axis == 0:
                self.settings.set(0, "comm.address", _integer(value))
            case ["tools", "echo", *rest]:
                return " ".join(rest)
            case ["system", "reset"] if axis == 0:
                device.power_cycle()
            case _:
                raise StageRefusedError("BADCOMMAND")
        return "0"

    def _move(self, words: list[str]) -> None:
        """Execute a `move` command: kind, target or speed, and optionally speed and acceleration."""
        device, (kind, *values) = self.device, [*words, ""]
        numbers = [_integer(value) for value in values if value]
        ends = {"min": device.limit_min, "max": device.limit_max}
        if kind in ends:
            numbers.insert(0, ends[kind])
        if not 1 <= len(numbers) <= 3:
            raise StageRefusedError("BADDATA" if kind in ("abs", "rel", "vel", *ends) else "BADCOMMAND")
        target, *rest = numbers
        if any(number <= 0 for number in rest):
            raise StageRefusedError("BADDATA")
        if kind == "vel":
            device.turn(target / SPEED_UNIT, *(number / ACCELERATION_UNIT for number in rest[:1]))
            return
        own = [number / unit for number, unit in zip(rest, (SPEED_UNIT, ACCELERATION_UNIT), strict=False)]
        if kind == "rel":
            device.move_by(target, *own)
        elif kind == "abs" or kind in ends:
            device.move_to(target, *own)
        else:
            raise StageRefusedError("BADCOMMAND")


def _changed(reply: bytes, place: int, byte: int) -> bytes:
    return reply[:place] + bytes([byte]) + reply[place + 1 :]


def _integer(text: str) -> int:
    try:
        number = int(text)
    except ValueError as error:
        raise StageRefusedError("BADDATA") from error
    if abs(number) > NUMBER_MAX:
        raise StageRefusedError("BADDATA")
    return number
