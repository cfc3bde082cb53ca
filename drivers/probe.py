"""Who answers at a serial port or a network address? Asked only what changes nothing, in a bounded time."""

from dataclasses import dataclass, field

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.lines.channel import CHANNEL_ERRORS, TCP_PREFIX, Channel, open_channel
from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.bus.pdu import NOBODY, ExceptionAnswerError, ForeignAnswerError, read_request
from drivers.load_frames.modbus.bus.wire import SilenceError
from drivers.load_frames.modbus.registers.map import load_map, shipped_maps
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.stages.esp301 import protocol as esp301_protocol
from drivers.stages.zaber import port as zaber_port
from drivers.stages.zaber import protocol as zaber_protocol

ANSWER_S = 0.3
LINE_S = 0.1
CONNECT_S = 2.0
ESP_BAUDS = (921_600, 19_200)
# The specification's own setting, and the usual ones.
MODBUS_LINES = ((19_200, "E"), (9600, "N"), (9600, "E"), (115_200, "N"))
SERIAL_UNITS = (1, 2, 3)
TCP_UNITS = (1, 255, 0)

STAGE, LOAD_FRAME = "stage", "load_frame"


@dataclass(frozen=True)
class Found:
    """A device that answered.

    Attributes
    ----------
    kind : str
        ``stage`` or ``load_frame``, as in a rig file.
    driver : str
        The driver for it; empty if it speaks Modbus but none of the shipped maps fits.
    what : str
        Who it is, in words.
    settings : dict
        What a rig file would say about it.
    """

    kind: str
    driver: str
    what: str
    settings: dict[str, str | int] = field(default_factory=dict)


def probe_serial(path: str) -> list[Found]:
    """Ask whether Zaber, Newport or Modbus devices are at a serial port.

    Behind ``socket://host:port`` it looks for stages only: Modbus has addresses of its own for TCP.

    Raises
    ------
    OSError, termios.error
        If the port cannot be opened; another program may hold it.
    """
    stages = _zaber(path) or _esp301(path)
    return stages or ([] if path.startswith(TCP_PREFIX) else _modbus_rtu(path))


def probe_modbus_tcp(address: str) -> list[Found]:
    """Ask whether Modbus devices are at ``host:port`` or ``rtu://host:port``, under the usual units."""
    place = ModbusAddress(address)
    units, timeout_s = (SERIAL_UNITS, ANSWER_S) if place.rtu else (TCP_UNITS, CONNECT_S)
    return _modbus(place, units, {"address": address}, timeout_s)


def _zaber(path: str) -> list[Found]:
    """Everybody on the line says who it is, by address."""
    found = []
    with_serial = zaber_protocol.encode(0, 0, 1, "get system.serial")
    for line in _lines(path, zaber_port.BAUD, with_serial):
        try:
            reply = zaber_protocol.decode(line)
        except zaber_protocol.DamagedLineError:
            continue
        if reply is not None and reply.accepted:
            settings: dict[str, str | int] = {"port": path}
            if reply.address != 1:
                settings["address"] = reply.address
            what = f"Zaber device {reply.address}, serial number {reply.data}"
            found.append(Found(STAGE, "zaber-ascii", what, settings))
    return found


def _esp301(path: str) -> list[Found]:
    for baud in ESP_BAUDS:
        for line in _lines(path, baud, b"VE?" + esp301_protocol.END):
            match = esp301_protocol.MODEL.fullmatch(line.decode("ascii", "replace"))
            if match is not None:
                settings: dict[str, str | int] = {"port": path, "baud": baud}
                what = f"Newport {match['model']}, firmware {match['firmware']}"
                return [Found(STAGE, "newport-esp301", what, settings)]
    return []


def _modbus_rtu(path: str) -> list[Found]:
    for baud, parity in MODBUS_LINES:
        settings: dict[str, str | int] = {"address": path, "baud": baud, "parity": parity}
        if found := _modbus(ModbusAddress(path, baud, parity), SERIAL_UNITS, settings, LINE_S):
            return found
    return []


def _lines(path: str, baud: int, question: bytes) -> list[bytes]:
    """Return what is answered to a question, in lines."""
    channel = open_channel(path, baud, ANSWER_S)
    try:
        channel.drain()
        channel.send(question)
        return [line for line in _all(channel).replace(b"\r", b"\n").split(b"\n") if line]
    finally:
        channel.close()


def _all(channel: Channel) -> bytes:
    received = b""
    end_s = SystemClock().now_s() + ANSWER_S
    while data := channel.receive(end_s):
        received += data
    return received


def _modbus(
    place: ModbusAddress, units: tuple[int, ...], settings: dict[str, str | int], timeout_s: float
) -> list[Found]:
    found = []
    for unit in units:
        if _answers(place, unit, timeout_s):
            given = settings if unit == 1 else settings | {"unit": unit}
            found.append(_described(place, unit, given, timeout_s))
            if not place.rtu:
                # on TCP these are names of one and the same
                break
    return found


def _answers(place: ModbusAddress, unit: int, timeout_s: float) -> bool:
    """Whether anything comes back that is Modbus, a refusal included."""
    request = read_request("holding", 0, 1)
    try:
        wire = place.open(CONNECT_S)
    except CHANNEL_ERRORS:
        if place.serial:
            raise
        return False
    try:
        request.registers(wire.ask(unit, request.pdu, timeout_s, None))
    except ExceptionAnswerError as refusal:
        return refusal.code not in NOBODY
    except (SilenceError, ForeignAnswerError, *CHANNEL_ERRORS):
        return False
    finally:
        wire.close()
    return True


def _described(place: ModbusAddress, unit: int, settings: dict[str, str | int], timeout_s: float) -> Found:
    """Find the shipped map whose blocks are all there, with its revision."""
    link = ModbusLink("probe", place, unit, max(timeout_s, ANSWER_S))
    try:
        for name in shipped_maps():
            if (serial := _serial_by_map(link, name)) is not None:
                what = f"Modbus unit {unit}, register map {name!r}, serial number {serial}"
                return Found(LOAD_FRAME, "modbus-frame", what, settings | {"map": name})
    finally:
        link.close()
    return Found(LOAD_FRAME, "", f"Modbus unit {unit}, which no shipped register map fits", settings)


def _serial_by_map(link: ModbusLink, name: str) -> int | None:
    """Return the serial number a map finds; None if not all its blocks are there, or its revision is not."""
    register_map = load_map(name)
    device = MappedDevice(link, register_map)
    blocks = register_map.blocks
    try:
        for block in (blocks.command, blocks.limits, blocks.watchdog, blocks.heartbeat, blocks.setpoints):
            if block is not None:
                device.read(block, "probe", names=())
        device.read_status("probe")
        revision = device.read(blocks.state, "probe", names=("revision",))["revision"]
        serial = int(device.read(blocks.identity, "probe")["serial"])
    except DeviceError:
        return None
    return serial if revision == register_map.revision else None
