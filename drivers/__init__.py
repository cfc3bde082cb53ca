"""Interfaces to the devices of a test rig, one interface per kind of device, and the search for drivers.

All public names can be imported from the package `drivers`. The module that defines a name is loaded when the
name is first used:

>>> import drivers
>>> drivers.find_driver("zaber-ascii").kind
'stage'

To add your own driver, implement `Camera`, `RotationStage`, `LoadFrame`, `Interlock` or `Operator`, and
publish the driver as a `DriverSpec`. The package `drivers.testing` has the tests that every driver must pass.
A driver raises a `DeviceError` if its device does not execute a command. The error message is one sentence
that ends with the remedy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivers.clock import Clock, Event, SystemClock, VirtualClock
    from drivers.errors import ConfigurationError, DeviceError, DeviceFault, DeviceTimeout, LinkLost
    from drivers.interfaces import (
        Camera,
        CameraInfo,
        DeviceInfo,
        Frame,
        Interlock,
        InterlockState,
        LoadFrame,
        LoadFrameLimits,
        LoadFrameState,
        OpenContext,
        Operator,
        OperatorAction,
        ReadsSettings,
        RotationStage,
        Setting,
        StageState,
    )
    from drivers.registry import (
        DeviceKind,
        DriverSpec,
        Finder,
        Found,
        Guard,
        GuardSpec,
        SerialPort,
        driver_names,
        find_driver,
    )
    from drivers.settings import Settings

__all__ = [
    "Camera",
    "CameraInfo",
    "Clock",
    "ConfigurationError",
    "DeviceError",
    "DeviceFault",
    "DeviceInfo",
    "DeviceKind",
    "DeviceTimeout",
    "DriverSpec",
    "Event",
    "Finder",
    "Found",
    "Frame",
    "Guard",
    "GuardSpec",
    "Interlock",
    "InterlockState",
    "LinkLost",
    "LoadFrame",
    "LoadFrameLimits",
    "LoadFrameState",
    "OpenContext",
    "Operator",
    "OperatorAction",
    "ReadsSettings",
    "RotationStage",
    "SerialPort",
    "Setting",
    "Settings",
    "StageState",
    "SystemClock",
    "VirtualClock",
    "driver_names",
    "find_driver",
]

_NAMES_OF = {
    "drivers.clock": ("Clock", "Event", "SystemClock", "VirtualClock"),
    "drivers.errors": ("ConfigurationError", "DeviceError", "DeviceFault", "DeviceTimeout", "LinkLost"),
    "drivers.interfaces": (
        "Camera",
        "CameraInfo",
        "DeviceInfo",
        "Frame",
        "LoadFrame",
        "LoadFrameLimits",
        "LoadFrameState",
        "OpenContext",
        "Interlock",
        "InterlockState",
        "Operator",
        "OperatorAction",
        "ReadsSettings",
        "RotationStage",
        "Setting",
        "StageState",
    ),
    "drivers.registry": (
        "DeviceKind",
        "DriverSpec",
        "Finder",
        "Found",
        "Guard",
        "GuardSpec",
        "SerialPort",
        "driver_names",
        "find_driver",
    ),
    "drivers.settings": ("Settings",),
}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # type checkers would otherwise allow any name

    def __getattr__(name: str) -> Any:
        """Load a public name from its module when it is first used (PEP 562)."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'drivers' has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
