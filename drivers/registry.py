"""Drivers by name: ours and third parties' are found the same way, by entry point."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Literal

from drivers.interfaces import OpenContext
from drivers.settings import Settings

GROUP = "offaxis.drivers"

Kind = Literal["camera", "stage", "load_frame", "operator", "environment"]


@dataclass(frozen=True)
class DriverSpec:
    """How a driver is found, configured and opened.

    Attributes
    ----------
    kind : str
        Which of the interfaces in `drivers.interfaces` it implements.
    settings : type of Settings
        What the rig file may say about it; unknown keys are refused.
    open : callable
        ``open(settings, context)`` returns the device, ready, or raises `DeviceError`.
    """

    kind: Kind
    settings: type[Settings]
    open: Callable[[Any, OpenContext], Any]


def driver_names() -> list[str]:
    """Return the names of all installed drivers, sorted."""
    return sorted(point.name for point in entry_points(group=GROUP))


def find_driver(name: str) -> DriverSpec:
    """Return the driver of that name.

    Raises
    ------
    LookupError
        If no installed package offers it; the message lists those that exist.
    """
    for point in entry_points(group=GROUP, name=name):
        spec = point.load()
        if not isinstance(spec, DriverSpec):
            raise LookupError(f"driver {name!r}: entry point {point.value!r} is no DriverSpec")
        return spec
    raise LookupError(f"no driver {name!r} is installed; there are {', '.join(driver_names())}")
