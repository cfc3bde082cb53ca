"""Find Modbus devices at a serial port or a network address, and the shipped register map that fits."""

from drivers.errors import DeviceError
from drivers.lines.channel import CHANNEL_ERRORS, TCP_PREFIX
from drivers.lines.serial_ports import ANSWER_S, serial_ports
from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.bus.pdu import NOBODY, ExceptionAnswerError, ForeignAnswerError, read_request
from drivers.load_frames.modbus.bus.wire import SilenceError
from drivers.load_frames.modbus.registers.map import load_map, shipped_maps
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.registry import Finder, Found

LINE_ANSWER_S = 0.1
CONNECT_S = 2.0
# Baud rate and parity to try: first the default of the specification, then other usual settings.
LINES = ((19_200, "E"), (9600, "N"), (9600, "E"), (115_200, "N"))
COMMON_SERIAL_UNITS = (1, 2, 3)
COMMON_TCP_UNITS = (1, 255, 0)


def modbus_at_port(path: str) -> list[Found]:
    """Return the Modbus RTU devices at a serial port. Try the usual unit numbers, baud rates and parities.

    An address ``socket://host:port`` is not searched, because Modbus has its own form of TCP addresses. Raise
    `OSError` if the port cannot be opened, for example because another program uses the port.
    """
    if path.startswith(TCP_PREFIX):
        return []
    for baud, parity in LINES:
        settings: dict[str, str | int] = {"address": path, "baud": baud, "parity": parity}
        if found := _modbus(ModbusAddress(path, baud, parity), COMMON_SERIAL_UNITS, settings, LINE_ANSWER_S):
            return found
    return []


def modbus_at_address(address: str) -> list[Found]:
    """Return the Modbus devices at ``host:port`` or ``rtu://host:port``. Try the usual unit numbers."""
    place = ModbusAddress(address)
    units, timeout_s = (COMMON_SERIAL_UNITS, ANSWER_S) if place.rtu else (COMMON_TCP_UNITS, CONNECT_S)
    return _modbus(place, units, {"address": address}, timeout_s)


def _modbus(
    place: ModbusAddress, units: tuple[int, ...], settings: dict[str, str | int], timeout_s: float
) -> list[Found]:
    found = []
    for unit in units:
        if _answers(place, unit, timeout_s):
            given = settings if unit == 1 else settings | {"unit": unit}
            found.append(_described(place, unit, given, timeout_s))
            if not place.rtu:
                # try no other unit number, because on TCP they usually all reach the same device
                break
    return found


def _answers(place: ModbusAddress, unit: int, timeout_s: float) -> bool:
    """Return whether a unit answers. A refusal also counts as an answer."""
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
    """Describe a device by the shipped register map that has the same blocks and revision as the device."""
    link = ModbusLink("probe", place, unit, max(timeout_s, ANSWER_S))
    try:
        for name in shipped_maps():
            if (serial := _serial_by_map(link, name)) is not None:
                what = f"Modbus unit {unit}, register map {name!r}, serial number {serial}"
                return Found(what, settings | {"map": name})
    finally:
        link.close()
    return Found(f"Modbus unit {unit}, which no shipped register map fits", settings, usable=False)


def _serial_by_map(link: ModbusLink, name: str) -> int | None:
    """Return the device's serial number. Return None if the register map `name` does not fit the device."""
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


FINDER = Finder(
    "load frames on Modbus",
    ports=serial_ports,
    at_port=modbus_at_port,
    at_modbus=modbus_at_address,
    asks_for_s=len(LINES) * len(COMMON_SERIAL_UNITS) * LINE_ANSWER_S,
)
