"""Find drivers by name. Every driver, of this project or of a third party, is a Python entry point."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any, Literal, Protocol

from drivers.interfaces import OpenContext
from drivers.settings import Settings, shown

GROUP = "offaxis.drivers"

DeviceKind = Literal[
    "camera", "stage", "load_frame", "operator", "environment", "interlock", "channels", "trigger"
]


@dataclass(frozen=True)
class SerialPort:
    """A serial port of this computer.

    Attributes
    ----------
    path : str
        Path of the port. If possible, this path stays the same when the adapter is plugged in again.
    description : str
        Description of the port, as reported by the serial adapter.
    """

    path: str
    description: str


@dataclass(frozen=True)
class Found:
    """A device that a driver found.

    Attributes
    ----------
    what : str
        Name of the device, shown to the user.
    settings : dict
        Settings of the device in a rig file. The first setting tells which device it is: a device
        node, a port, an address, or the identifier of a camera.
    usable : bool
        True if the driver can open the device with these settings. A generated rig file lists unusable
        devices as comments.
    """

    what: str
    settings: Mapping[str, str | int] = field(default_factory=dict)
    usable: bool = True

    @property
    def place(self) -> str:
        """Location of the device, taken from the first setting, or an empty text if there are no settings."""
        return str(next(iter(self.settings.values()), ""))


@dataclass(frozen=True)
class Finder:
    """The search functions of a driver. A function that the driver does not support is None.

    A search function must end within a limited time, change no setting and start no motion. If the search is
    impossible, the function raises `OSError` with the reason. Several drivers query a port one after the
    other. When a driver has found its device at a port, no other driver queries that port.

    Attributes
    ----------
    what : str
        Name of the kind of device, shown to the user, for example ``Zaber stages``.
    listed : callable, optional
        ``listed()`` returns the devices that the operating system lists, without a message to any device.
    answering : callable, optional
        ``answering()`` returns the devices that answer a query on networks and buses.
    ports : callable, optional
        ``ports()`` returns the serial ports that may be passed to `at_port`.
    at_port : callable, optional
        ``at_port(path)`` returns the devices that answer at a serial port or behind ``socket://host:port``.
    at_modbus : callable, optional
        ``at_modbus(address)`` returns the Modbus devices at ``host:port`` or ``rtu://host:port``.
    asks_for_s : float
        Time, in seconds, that a query takes at a port where nothing answers. Drivers with short queries go
        first.
    """

    what: str
    listed: Callable[[], Sequence[Found]] | None = None
    answering: Callable[[], Sequence[Found]] | None = None
    ports: Callable[[], Sequence[SerialPort]] | None = None
    at_port: Callable[[str], Sequence[Found]] | None = None
    at_modbus: Callable[[str], Sequence[Found]] | None = None
    asks_for_s: float = 1.0


GUARD_STOP_MAX_S = 10.0
"""Longest time in s of one call of `Guard.stop`, twice the deadline of the stop in the drivers of offaxis."""


class Guard(Protocol):
    """Interface with which a guardian process stops a device. The guard has a connection to the device.

    Attributes
    ----------
    relay : str
        Address ``host:port`` on this computer at which the driver reaches the device, if the guard owns the
        only line to the device, otherwise an empty text.
    """

    relay: str

    def check(self) -> None:
        """Check without a command that a stop would reach the device. Raise `DeviceError` otherwise."""

    def stop(self) -> None:
        """Stop the device, and wait for standstill. Raise `DeviceError` if the device does not confirm.

        A call that takes longer than `GUARD_STOP_MAX_S` counts as hanging. After a stop, a guard that owns
        the only line passes no more messages of the driver to the device. `stop` may be called again.
        """

    def close(self) -> None:
        """Release the line without stopping the device. A repeated call has no effect."""


@dataclass(frozen=True)
class GuardSpec:
    """Functions with which a guardian process connects to a device of a driver.

    Attributes
    ----------
    line : callable
        ``line(settings)`` returns the name of the line to the device: the real path of a port, or
        ``host:port``. The name is empty for a simulated device inside this program, which needs no guardian.
    open : callable
        ``open(settings, context)`` returns a `Guard` that is connected to the device, or raises
        `DeviceError`. The function must not start a motion. The guardian process calls the function before
        the driver opens the device.
    """

    line: Callable[[Any], str]
    open: Callable[[Any, OpenContext], Guard]


@dataclass(frozen=True)
class DriverSpec:
    """Description of a driver: kind of device, class of settings, and functions to open and find devices.

    Attributes
    ----------
    kind : str
        Kind of device, which names the interface in `drivers.interfaces`. An ``environment`` is a simulated
        rig.
    settings : type of Settings
        Class that defines the keys of the device in the rig file. Unknown keys are refused.
    open : callable
        ``open(settings, context)`` returns the opened device or raises `DeviceError`.
    find : Finder, optional
        Functions with which the command ``rig devices`` finds devices of this driver.
    guard : GuardSpec, optional
        For a stage or a load frame: functions with which a guardian process stops the device when the process
        of the run dies or hangs. If `guard` is missing, every plan and every start of a run prints a warning.
    cautions : callable, optional
        ``cautions(settings)`` returns warnings about dangerous settings. Every plan and every start of a run
        prints these warnings.
    """

    kind: DeviceKind
    settings: type[Settings]
    open: Callable[[Any, OpenContext], Any]
    find: Finder | None = None
    guard: GuardSpec | None = None
    cautions: Callable[[Any], Sequence[str]] | None = None


def driver_names() -> list[str]:
    """Return the names of all installed drivers, sorted and without duplicates."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def find_driver(name: str) -> DriverSpec:
    """Return the driver called `name`.

    Raises
    ------
    LookupError
        If no installed package or several packages offer the driver, or if the driver cannot be loaded.
    """
    points = {point.value: point for point in entry_points(group=GROUP, name=name)}
    if not points:
        raise LookupError(f"no driver {shown(name)} is installed; there are {', '.join(driver_names())}")
    if len(points) > 1:
        raise LookupError(
            f"driver {name!r} is offered more than once: {', '.join(points)}; remove one package"
        )
    (point,) = points.values()
    try:
        spec = point.load()
    # catch every exception, because a third party's module may raise any type
    except Exception as error:
        raise LookupError(
            f"driver {name!r}: {point.value!r} cannot be loaded: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(spec, DriverSpec):
        raise LookupError(f"driver {name!r}: entry point {point.value!r} is not a DriverSpec")
    return spec
