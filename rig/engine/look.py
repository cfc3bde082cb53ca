"""Read the present state of the devices, and check whether the specimen is under load."""

from dataclasses import dataclass
from typing import Any

from rig.devices import Rig
from rig.engine.calls import Call, Calls
from rig.engine.devices import Devices
from rig.engine.status import AtRest
from rig.errors import LimitViolation
from rig.protocol.conditions import Conditions
from rig.protocol.step import Reading

UNLOADED_SHARE = 0.01
"""An unloaded load cell may show this fraction of the largest load, from zero error and weight of grips."""


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


@dataclass(frozen=True)
class Unloaded:
    """The load up to which a specimen counts as unloaded, so that a person may touch it.

    Attributes
    ----------
    load_max_n : float
        The largest load in N, in tension and in compression.
    remedy : str
        What to do if the load reading exceeds `load_max_n` although the specimen is unloaded.
    """

    load_max_n: float
    remedy: str

    def require(self, reading: Reading, step: str) -> None:
        """Raise `LimitViolation` if the specimen is loaded, for example after a failed run.

        The operator must not touch a loaded specimen, and its load must not be set to zero.
        """
        if not abs(reading.load_n) <= self.load_max_n:
            raise LimitViolation(
                step,
                f"a load within {self.load_max_n:g} N",
                f"{reading.load_n:.1f} N",
                "unload the specimen with rig unload, as a real load must not be zeroed; if the specimen is "
                f"unloaded, {self.remedy.format(load_n=abs(reading.load_n))}",
            )


def unloaded(conditions: Conditions, rig: Rig) -> Unloaded | None:
    """Return the load up to which a specimen counts as unloaded, or None if no load frame is used.

    The load comes from the protocol if the protocol pulls the specimen, and otherwise from the rig.
    """
    if conditions.zeroing is not None:
        key = conditions.zeroing.key
        return Unloaded(
            conditions.zeroing.tare_max_n,
            f"raise {key} above {{load_n:.1f}} (at most a tenth of an increment), or zero the load cell at "
            "the machine",
        )
    if rig.load_frame is None:
        return None
    most_n = rig.limits.unloaded_max_n
    return Unloaded(
        UNLOADED_SHARE * rig.load_frame.limits.load_max_n if most_n is None else most_n,
        "zero the load cell at the machine, or raise limits.unloaded_max_n in the rig file above "
        "{load_n:.1f}",
    )
