"""A load frame that is only read: its load at rest, and what to say when it should be moved."""

import math
from dataclasses import replace

from drivers.errors import DeviceError
from rig import AtRest, Rig, RigError
from rig.channels.run_channels import RunChannels
from rig.engine.calls import Calls
from rig.engine.status import MeasuredAtRest
from rig.rigfile import RigFile

_POLL_S = 0.02


def channels_of_load(rig_file: RigFile) -> RigFile:
    """Return the rig with only those channel devices that measure its load and displacement."""
    names = set() if rig_file.measured_load is None else set(rig_file.measured_load.signals.values())
    channels = {
        name: entry
        for name, entry in rig_file.channels.items()
        if names & {signal.name for signal in entry.setting("declared") or ()}
    }
    return replace(rig_file, channels=channels)


def with_measured(at_rest: AtRest, rig: Rig, calls: Calls) -> AtRest:
    """Return the readings of a rig at rest with the newest load of a load frame that is only read."""
    if not rig.measured or not rig.channels:
        return at_rest
    channels = RunChannels(rig.channels, rig.clock)
    try:
        channels.begin()
        while not channels.are_ready:
            calls.pause(_POLL_S)
        signals = channels.read()
    except DeviceError as error:
        return replace(at_rest, silent=at_rest.silent | {"load_frame": str(error)})
    finally:
        rig.lost.update(channels.end())
    values = {quantity: signals[name].newest for quantity, name in rig.measured.items() if name in signals}
    measured = MeasuredAtRest(values.get("load", math.nan), values.get("displacement", math.nan))
    return replace(at_rest, measured=measured)


def takes_no_commands(rig_file: RigFile, doing: str) -> RigError | None:
    """Return the error for a command to a load frame that is only read; None for another rig."""
    if (measured := rig_file.measured_load) is None:
        return None
    return RigError(
        doing,
        "a load frame that takes commands",
        f"one that is only read (load = {measured.load!r})",
        "move and stop it at its own controls; in danger press its emergency stop",
    )
