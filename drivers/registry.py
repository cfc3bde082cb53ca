"""Drivers by name: ours and third parties' are found the same way, by entry point."""

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
        Lasting, where the system keeps such a name.
    description : str
        As the adapter says.
    """

    path: str
    description: str


@dataclass(frozen=True)
class Found:
    """A device that a driver found.

    Attributes
    ----------
    what : str
        Who it is, in words.
    settings : dict
        What a rig file would say about it. The first setting is its place: a node, a port, an address.
    usable : bool
        Whether the driver can open it so; a rig file offers any other as a comment.
    """

    what: str
    settings: Mapping[str, str | int] = field(default_factory=dict)
    usable: bool = True

    @property
    def place(self) -> str:
        """Where the device is; empty without settings."""
        return str(next(iter(self.settings.values()), ""))


@dataclass(frozen=True)
class Finder:
    """Where a driver looks for its devices; what it cannot do is left out.

    Each function ends soon, changes no setting, moves nothing, and raises `OSError` with the reason if it
    cannot look. Ports are asked by one driver at a time; a port at which one found its device is asked by no
    other.

    Attributes
    ----------
    what : str
        What is looked for, in words for a person: ``Zaber stages``.
    listed : callable, optional
        ``listed()`` returns the devices that the system lists. It sends nothing to anybody.
    answering : callable, optional
        ``answering()`` returns the devices that answer on networks and buses.
    ports : callable, optional
        ``ports()`` returns the serial ports at which `at_port` may look.
    at_port : callable, optional
        ``at_port(path)`` returns the devices that answer at a serial port or behind ``socket://host:port``.
    at_modbus : callable, optional
        ``at_modbus(address)`` returns those at ``host:port`` (Modbus TCP) or ``rtu://host:port``.
    asks_for_s : float
        How long a port is asked in vain. Quick drivers go first.
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
    """How a driver is found, configured and opened.

    Attributes
    ----------
    kind : str
        Which of the interfaces in `drivers.interfaces` it implements; an ``environment`` is a simulated rig.
    settings : type of Settings
        What the rig file may say about it; unknown keys are refused.
    open : callable
        ``open(settings, context)`` returns the device, ready, or raises `DeviceError`.
    find : Finder, optional
        How ``rig devices`` finds its devices.
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
        If no installed package offers it, more than one does, or it cannot be loaded.
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
    # somebody else's module may fail in any way
    except Exception as error:
        raise LookupError(
            f"driver {name!r}: {point.value!r} cannot be loaded: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(spec, DriverSpec):
        raise LookupError(f"driver {name!r}: entry point {point.value!r} is no DriverSpec")
    return spec
