"""The load, displacement and angle of the machines at rest, as a printed line and as a JSON table."""

import math
from dataclasses import asdict
from typing import Any

from drivers.interfaces import LoadFrameState, StageState
from rig import AtRest
from rig.engine.status import MeasuredAtRest


def at_rest_line(at_rest: AtRest) -> str:
    """Return one sentence with load, displacement and angle of the load frame and the stage at rest."""
    parts = []
    if at_rest.load_frame is not None:
        parts.append(_load_frame(at_rest.load_frame))
    if at_rest.measured is not None:
        parts.append(_measured(at_rest.measured))
    if at_rest.stage is not None:
        parts.append(_stage(at_rest.stage))
    parts += [_silent(name, stopped=name in at_rest.stopped) for name in at_rest.silent]
    sentence = "; ".join(parts) or "the rig has no load frame and no stage"
    return f"{sentence[0].upper()}{sentence[1:]}."


def at_rest_dict(at_rest: AtRest) -> dict[str, Any]:
    """Return the states as a table for JSON, with None for a device that is missing or does not answer."""
    return {
        "load_frame": None if at_rest.load_frame is None else asdict(at_rest.load_frame),
        "stage": None if at_rest.stage is None else asdict(at_rest.stage),
        "measured": None if at_rest.measured is None else _measured_dict(at_rest.measured),
        "silent": dict(at_rest.silent),
    }


def _silent(name: str, *, stopped: bool) -> str:
    device = f"the {name.replace('_', ' ')}"
    if stopped:
        return f"{device} has confirmed that it stands still, and does not answer any more"
    return f"{device} does not answer, so nobody knows whether it moves"


def _load_frame(state: LoadFrameState) -> str:
    # at its target, a load frame may report small corrections by its controller as a motion
    if state.moving and not state.at_target:
        does = "MOVES"
    else:
        does = "holds" if state.holding else "stands without holding"
    faults = f", with the faults {', '.join(state.faults)}" if state.faults else ""
    return f"the load frame {does} at {state.load_n:.1f} N and {state.displacement_mm:.4f} mm{faults}"


def _measured(values: MeasuredAtRest) -> str:
    at = f"{values.load_n:.1f} N"
    if not math.isnan(values.displacement_mm):
        at += f" and {values.displacement_mm:.4f} mm"
    return f"the load frame takes no commands, and nobody knows whether it moves; it shows {at}"


def _measured_dict(values: MeasuredAtRest) -> dict[str, float | None]:
    return {key: None if math.isnan(value) else value for key, value in asdict(values).items()}


def _stage(state: StageState) -> str:
    does = "TURNS" if state.moving else "stands"
    unhomed = "" if state.homed else ", without a reference position"
    warnings = f", with the warnings {', '.join(state.warnings)}" if state.warnings and state.homed else ""
    return f"the stage {does} at {state.angle_deg:.2f} deg{unhomed}{warnings}"
