"""Read the present state of the load frame and the stage."""

from typing import Any

from rig.engine.calls import Call, Calls
from rig.engine.devices import Devices
from rig.engine.status import AtRest


def look(devices: Devices, calls: Calls, stopped: frozenset[str] = frozenset()) -> AtRest:
    """Read the load frame and the stage. For a device that does not answer, the result gives the reason.

    `stopped` are the devices that have just confirmed a hold or a stop.
    """
    silent: dict[str, str] = {}
    found: dict[str, Any] = {}
    for name, device in (("load_frame", devices.load_frame), ("stage", devices.stage)):
        # catch every exception, because a driver of a third party may raise any type
        try:
            if device is not None:
                call: Call[Any] = device.begin_read()
                found[name] = calls.finish(call)
        except Exception as error:
            silent[name] = str(error) or type(error).__name__
    return AtRest(silent=silent, stopped=stopped, **found)
