"""Read the settings of a device whose driver reports them, and check that they fit into a run file."""

import json
import math
from typing import Any

from dic.runfile.schema import SETTING_BYTES, SETTING_NAME_BYTES
from drivers.errors import DeviceFault
from drivers.interfaces import Setting

_SETTINGS_MAX = 100


def reports_settings(device: object) -> bool:
    """Return whether the driver of a device has the method ``read_settings``."""
    return callable(getattr(device, "read_settings", None))


def read_settings(name: str, device: Any) -> dict[str, Setting]:
    """Return the settings that a device reports. `name` is the device's name in the rig file.

    Raise `DeviceError` if the device does not answer, or if its driver returns anything other than settings.
    """
    found = device.read_settings()
    if not isinstance(found, dict) or len(found) > _SETTINGS_MAX:
        raise _fault(name, f"a table of at most {_SETTINGS_MAX} settings", repr(found))
    for key, value in found.items():
        if not isinstance(key, str) or not 0 < len(key.encode()) <= SETTING_NAME_BYTES:
            raise _fault(name, f"names of 1 to {SETTING_NAME_BYTES} characters", repr(key))
        if type(value) not in (str, float, int, bool) or (
            isinstance(value, float) and not math.isfinite(value)
        ):
            raise _fault(name, f"a text, a finite number, true or false as {key}", repr(value))
        if len(encode(value).encode()) > SETTING_BYTES:
            raise _fault(name, f"at most {SETTING_BYTES} bytes as {key}", repr(value))
    return found


def encode(value: Setting) -> str:
    """Return the value of a setting as JSON."""
    return json.dumps(value, ensure_ascii=False)


def _fault(name: str, expected: str, got: str) -> DeviceFault:
    return DeviceFault(name, "read settings", expected, got[:80], "report it to the author of the driver")
