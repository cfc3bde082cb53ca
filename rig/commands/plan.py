"""A plan as `rig plan` prints it, and as a table for JSON."""

import math
from typing import Any

from rig import Plan
from rig.plan import format_bytes
from rig.protocol.step import UNITS


def plan_lines(plan: Plan) -> list[str]:
    """Return the plan as lines of text."""
    lines = [f"{plan.title} ({plan.kind})", "step  kind          target        about"]
    for planned in plan.steps:
        step = planned.step
        target = "" if math.isnan(step.target) else f"{step.target:g} {UNITS[step.kind]}"
        note = "  if the specimen demands it" if step.conditional else ""
        about = _format_s(planned.duration_s)
        lines.append(f"{step.index:4d}  {step.kind:<12}  {target:<10}  {about:>8}{note}")
    at_most = " at most" if any(planned.step.conditional for planned in plan.steps) else ""
    lines.append(
        f"{len(plan.steps)} steps{at_most}, about {_format_s(plan.duration_s)} without the operator's time; "
        + _format_images(plan)
    )
    if at_most:
        lines.append(
            f"worst load {plan.worst_load_n:g} N, worst displacement {plan.worst_displacement_mm:g} mm: "
            "the limits of the protocol, as the specimen decides how many increments it takes to yield"
        )
    return lines + [f"not on this rig: {objection}" for objection in plan.objections]


def plan_dict(plan: Plan) -> dict[str, Any]:
    """Return the plan for JSON: what is unknown or does not apply is None."""
    return {
        "title": plan.title,
        "kind": plan.kind,
        "steps": [
            {
                "index": planned.step.index,
                "kind": planned.step.kind,
                "target": _known(planned.step.target),
                "unit": UNITS[planned.step.kind],
                "conditional": planned.step.conditional,
                "duration_s": planned.duration_s,
            }
            for planned in plan.steps
        ],
        "duration_s": plan.duration_s,
        "images": plan.images,
        "size_bytes": plan.size_bytes,
        "worst_load_n": _known(plan.worst_load_n),
        "worst_displacement_mm": _known(plan.worst_displacement_mm),
        "objections": plan.objections,
    }


def _format_images(plan: Plan) -> str:
    if plan.images is None:
        return "images: as the rig has cameras"
    size = plan.size_bytes
    shown = "size unknown until the cameras are open" if size is None else format_bytes(size)
    return f"{plan.images} images, {shown}"


def _format_s(duration_s: float | None) -> str:
    if duration_s is None:
        return "unknown"
    return f"{duration_s:.1f} s" if duration_s < 120.0 else f"{duration_s / 60.0:.1f} min"


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
