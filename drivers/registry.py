"""Drivers by name. Our own and third parties' drivers are both found by entry point."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any, Literal

from drivers.interfaces import OpenContext
from drivers.settings import Settings

GROUP = "offaxis.drivers"

DeviceKind = Literal["camera", "stage", "load_frame", "operator", "environment"]


@dataclass(frozen=True)
class SerialPort:
    """A serial port of this machine.

    Attributes
    ----------
    path : str
        A persistent name, if the system has one.
    description : str
        As reported by the adapter.
    """

    path: str
    description: str


@dataclass(frozen=True)
class Found:
    """A device that a driver found.

    Attributes
    ----------
    what : str
        Name of the device, for people.
    settings : dict
        Settings of the device in a rig file. The first setting is its location: a node, a port or an address.
    usable : bool
        Whether the driver can open the device with these settings; a generated rig file lists unusable
        devices as comments.
    """

    what: str
    settings: Mapping[str, str | int] = field(default_factory=dict)
    usable: bool = True

    @property
    def place(self) -> str:
        """Location of the device; empty without settings."""
        return str(next(iter(self.settings.values()), ""))


@dataclass(frozen=True)
class Finder:
    """How a driver looks for its devices; methods that the driver does not support are None.

    Each function ends soon, changes no setting, starts no motion, and raises `OSError` with the reason if the
    search is impossible. Drivers query a port one after the other. When a driver has found its device at a
    port, no other driver queries that port.

    Attributes
    ----------
    what : str
        Name of the devices, for people: ``Zaber stages``.
    listed : callable, optional
        ``listed()`` returns the devices that the system lists. The call sends nothing to any device.
    answering : callable, optional
        ``answering()`` returns the devices that answer on networks and buses.
    ports : callable, optional
        ``ports()`` returns the serial ports at which `at_port` may look.
    at_port : callable, optional
        ``at_port(path)`` returns the devices that answer at a serial port or behind ``socket://host:port``.
    at_modbus : callable, optional
        ``at_modbus(address)`` returns the devices at ``host:port`` (Modbus TCP) or ``rtu://host:port``.
    asks_for_s : float
        Duration of a query at a port without an answer. Drivers with short queries go first.
    """

    what: str
    listed: Callable[[], Sequence[Found]] | None = None
    answering: Callable[[], Sequence[Found]] | None = None
    ports: Callable[[], Sequence[SerialPort]] | None = None
    at_port: Callable[[str], Sequence[Found]] | None = None
    at_modbus: Callable[[str], Sequence[Found]] | None = None
    asks_for_s: float = 1.0


@dataclass(frozen=True)
class DriverSpec:
    """Description of a driver: kind of device, settings, opening and search.

    Attributes
    ----------
    kind : str
        The interface in `drivers.interfaces` that the driver implements; an ``environment`` is a simulated
        rig.
    settings : type of Settings
        The keys that the rig file may contain; unknown keys are refused.
    open : callable
        ``open(settings, context)`` returns the device, ready for use, or raises `DeviceError`.
    find : Finder, optional
        The search of ``rig devices`` for devices of this driver.
    """

    kind: DeviceKind
    settings: type[Settings]
    open: Callable[[Any, OpenContext], Any]
    find: Finder | None = None


def driver_names() -> list[str]:
    """Return the names of all installed drivers, sorted, each once."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def find_driver(name: str) -> DriverSpec:
    """Return the driver of that name.

    Raises
    ------
    LookupError
        If no installed package or several packages offer the driver, or if the driver cannot be loaded.
    """
    points = {point.value: point for point in entry_points(group=GROUP, name=name)}
    if not points:
        raise LookupError(f"no driver {name!r} is installed; there are {', '.join(driver_names())}")
    if len(points) > 1:
        raise LookupError(
            f"driver {name!r} is offered more than once: {', '.join(points)}; remove one package"
        )
    (point,) = points.values()
    try:
        spec = point.load()
    # a third party's module may raise any exception
    except Exception as error:
        raise LookupError(
            f"driver {name!r}: {point.value!r} cannot be loaded: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(spec, DriverSpec):
        raise LookupError(f"driver {name!r}: entry point {point.value!r} is no DriverSpec")
    return spec
