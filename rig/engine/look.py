"""Read the present state of the devices, and check whether the specimen is under load."""

from drivers.interfaces import LoadFrameState, StageState
from rig.engine.calls import Calls
from rig.engine.devices import Devices
from rig.engine.status import AtRest
from rig.errors import LimitViolation
from rig.protocol.conditions import Zeroing
from rig.protocol.step import Reading


def look(devices: Devices, calls: Calls) -> AtRest:
    """Read the load frame and the stage. If a device does not answer, the result has the reason, and no error
    is raised."""
    silent: dict[str, str] = {}
    frame: LoadFrameState | None = None
    stage: StageState | None = None
    # a driver of a third party may raise any exception
    try:
        if devices.load_frame is not None:
            frame = calls.finish(devices.load_frame.begin_read())
    except Exception as error:
        silent["load_frame"] = str(error) or type(error).__name__
    try:
        if devices.stage is not None:
            stage = calls.finish(devices.stage.begin_read())
    except Exception as error:
        silent["stage"] = str(error) or type(error).__name__
    return AtRest(frame, stage, silent)


def require_unloaded(reading: Reading, zeroing: Zeroing, step: str) -> None:
    """Raise `LimitViolation` if the load is above `tare_max_n`, for example after a failed run.

    The operator must not touch a loaded specimen, and its load must not be set to zero.
    """
    if not abs(reading.load_n) <= zeroing.tare_max_n:
        raise LimitViolation(
            step,
            f"a load within {zeroing.tare_max_n:g} N",
            f"{reading.load_n:.1f} N",
            "unload the specimen with rig unload, as a real load must not be zeroed; if the specimen is "
            f"unloaded, raise {zeroing.key} above {abs(reading.load_n):.1f} (at most a tenth of an "
            "increment), or zero the load cell at the machine",
        )
