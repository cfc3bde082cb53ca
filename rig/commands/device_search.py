"""Search for devices with every installed driver. The drivers query a port one after the other."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from drivers.errors import DeviceError
from drivers.registry import DriverSpec, Finder, Found, SerialPort, driver_names, find_driver
from rig.errors import RigError

# Modbus address: `host` or `host:port`, with or without the prefix `rtu://`. Brackets enclose an IPv6
# address.
_MODBUS = re.compile(r"((?:rtu://)?(?:\[[^\[\]\s]+\]|[^:\s\[\]/]+))(?::(\d{1,5}))?")
MODBUS_PORT = 502
NOT_ASKED = "not asked"


@dataclass(frozen=True)
class Device:
    """A device that `rig devices` found, and the driver with which it was found."""

    driver: str
    spec: DriverSpec
    found: Found


@dataclass(frozen=True)
class DevicePlace:
    """A serial port or a Modbus address, and the devices that answer at this place."""

    address: str
    description: str  # description of a serial port, as reported by its adapter
    devices: list[Device]
    # reasons why drivers could not query this place, or an empty text if a device answered or no error
    # occurred
    trouble: str


@dataclass(frozen=True)
class Unsearched:
    """A kind of devices that `rig devices` could not search for, a description, and the reason."""

    kind: str
    what: str
    why: str


@dataclass
class Search:
    """The result of a search for devices."""

    # devices that the system lists, and devices that answer on networks and buses
    devices: list[Device] = field(default_factory=list)
    unsearched: list[Unsearched] = field(default_factory=list)
    unloaded: list[str] = field(default_factory=list)  # one message for each driver that cannot be loaded
    # the serial ports and the Modbus addresses of the search
    ports: list[DevicePlace] = field(default_factory=list)
    modbus: list[DevicePlace] = field(default_factory=list)


@dataclass(frozen=True)
class _Seeker:
    """A driver that can search for its devices."""

    driver: str
    spec: DriverSpec
    finder: Finder

    def devices(self, found: Sequence[Found]) -> list[Device]:
        return [Device(self.driver, self.spec, each) for each in found]

    def reason(self, error: Exception, before: str = "") -> str:
        """Return the reason why a search failed. A third party's driver may raise any exception."""
        if isinstance(error, (OSError, DeviceError)):
            return f"{before}{error}"
        return f"driver {self.driver!r} failed: {type(error).__name__}: {error}"


def search(ports: Sequence[str], hosts: Sequence[str], *, ask: bool) -> Search:
    """Search for devices.

    `ports` are searched in addition to the serial ports that the system lists. ``socket://host:port`` is also
    accepted. `hosts` are Modbus addresses: ``host`` or ``host:port`` for Modbus TCP, ``rtu://host:port`` for
    RTU over TCP. If `ask` is True, devices are asked for their identity. The queries change no setting, but
    an unknown device may receive unexpected bytes. Raise `RigError` if a Modbus address is malformed. No
    device has been queried before this error.
    """
    addresses = [_with_port(host) for host in hosts]
    found = Search()
    seekers = _seekers(found)
    for seeker in seekers:
        _look(seeker, seeker.finder.listed, found)
        _look(seeker, seeker.finder.answering, found, ask=ask)
    at_port = [(each, each.finder.at_port) for each in seekers]
    for port in _serial_ports(seekers, ports, found):
        found.ports.append(_asked(port, at_port, ask=ask))
    at_modbus = [(each, each.finder.at_modbus) for each in seekers]
    for address in addresses:
        found.modbus.append(_asked(SerialPort(address, ""), at_modbus, ask=ask))
    return found


def _seekers(search: Search) -> list[_Seeker]:
    """Return every driver that can search for its devices, quick drivers first.

    Add an entry to `search.unloaded` for each driver that cannot be loaded.
    """
    seekers = []
    for name in driver_names():
        try:
            spec = find_driver(name)
        except LookupError as error:
            search.unloaded.append(str(error))
            continue
        if spec.find is not None:
            seekers.append(_Seeker(name, spec, spec.find))
    return sorted(seekers, key=lambda seeker: seeker.finder.asks_for_s)


def _look(
    seeker: _Seeker, look: Callable[[], Sequence[Found]] | None, search: Search, *, ask: bool = True
) -> None:
    """Add to `search` the devices that a driver finds, or the reason why the driver could not search."""
    if look is None:
        return
    why = NOT_ASKED
    if ask:
        try:
            search.devices += seeker.devices(look())
            return
        except Exception as error:
            why = seeker.reason(error)
    search.unsearched.append(Unsearched(seeker.spec.kind, seeker.finder.what, why))


def _serial_ports(seekers: list[_Seeker], named: Sequence[str], search: Search) -> list[SerialPort]:
    """Return the serial ports that the drivers list and the ports in `named`, without duplicates."""
    ports: dict[str, SerialPort] = {}
    for seeker in seekers:
        try:
            listed = seeker.finder.ports() if seeker.finder.ports is not None else ()
        except Exception as error:
            why = seeker.reason(error)
            search.unsearched.append(Unsearched(seeker.spec.kind, f"ports of {seeker.finder.what}", why))
            continue
        ports |= {port.path: port for port in listed if port.path not in ports}
    return [
        *ports.values(),
        *(SerialPort(path, "named") for path in dict.fromkeys(named) if path not in ports),
    ]


def _asked(
    port: SerialPort,
    questions: Sequence[tuple[_Seeker, Callable[[str], Sequence[Found]] | None]],
    *,
    ask: bool,
) -> DevicePlace:
    """Let one driver after the other query a port or address, until one finds its devices there."""
    if not ask:
        return DevicePlace(port.path, port.description, [], NOT_ASKED)
    troubles: dict[str, None] = {}
    for seeker, question in questions:
        try:
            found = question(port.path) if question is not None else ()
        except Exception as error:
            troubles[seeker.reason(error, "cannot be opened: ")] = None
            continue
        if found:
            return DevicePlace(port.path, port.description, seeker.devices(found), "")
    return DevicePlace(port.path, port.description, [], "; ".join(troubles))


def _with_port(address: str) -> str:
    match = _MODBUS.fullmatch(address)
    if match is None or int(match[2] or MODBUS_PORT) not in range(1, 2**16):
        raise RigError(
            "rig devices",
            "--modbus HOST[:PORT] or rtu://HOST[:PORT]",
            repr(address),
            "give an address such as 192.168.0.8:502, or name a serial port with --port",
        )
    return f"{match[1]}:{match[2] or MODBUS_PORT}"
