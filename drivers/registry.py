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
