"""The output of `rig plan`: a plan as lines to print, and as a table for JSON."""

import math
from typing import Any

from rig import Plan, PlannedStep
from rig.plan import AcquisitionPlan, format_bytes

LINES_MAX = 200
"""Largest number of steps that `rig plan` prints."""
_TENTH_NOTICED = 0.1


def plan_lines(plan: Plan) -> list[str]:
    """Return the plan as lines of text."""
    lines = [f"{plan.title} ({plan.kind})", "step  kind          target        about"]
    shown = _step_lines(plan)
    if len(shown) > LINES_MAX:
        hidden = len(shown) - LINES_MAX
        half = LINES_MAX // 2
        shown[half:-half] = [f"      … {hidden} more steps, which --json lists"]
    lines += shown
    if plan.acquisition is not None:
        return [*lines, _acquisition_line(plan, plan.acquisition), *_notes(plan)]
    at_most = " at most" if any(planned.step.conditional for planned in plan.steps) else ""
    lines.append(
        f"{len(plan.steps)} steps{at_most}, about {format_s(plan.duration_s)} without the operator's time; "
        + images_text(plan)
    )
    if not math.isnan(plan.worst_load_n):
        lines.append(
            f"worst load {_both_ways(plan.least_load_n, plan.worst_load_n)} N, worst displacement "
            f"{_both_ways(plan.least_displacement_mm, plan.worst_displacement_mm)} mm: "
            "the limits of the protocol"
            + (", as the specimen decides how many increments it takes to yield" if at_most else "")
        )
    return lines + _notes(plan)


def _notes(plan: Plan) -> list[str]:
    """Return the limits, the mounting, the cautions and the objections."""
    lines = _limit_lines(plan)
    lines += [f"mounting: {fact}" for fact in plan.mounting.facts()]
    lines += [f"caution: {caution}" for caution in plan.cautions]
    return lines + [f"not on this rig: {objection}" for objection in plan.objections]


def _limit_lines(plan: Plan) -> list[str]:
    lines = [f"limit: {limit}" for limit in plan.limits.table]
    string = plan.limits.string
    if string is not None:
        share = string.noticed_fraction
        lines.append(
            f"with any specimen within these limits, a load cell that shows less than {share:.1%} of the "
            "load is noticed in the first increment"
            + ("" if share > _TENTH_NOTICED else "; declare [plausible] moduli to notice a smaller error")
        )
    return lines


def _step_lines(plan: Plan) -> list[str]:
    """Return one line for each step, and one for all images of an acquisition together."""
    lines = [_step_line(planned) for planned in plan.steps if planned.step.acquisition is None]
    if plan.acquisition is not None:
        first = next(k for k, planned in enumerate(plan.steps) if planned.step.acquisition is not None)
        lines.insert(first, f"{plan.steps[first].step.index:4d}… images {plan.acquisition.text}")
    return lines


def _acquisition_line(plan: Plan, acquisition: AcquisitionPlan) -> str:
    """Return the duration, the number of images and their size, as far as they are known."""
    said = [
        "the duration is not known"
        if plan.duration_s is None
        else f"about {format_s(plan.duration_s)} without the operator's time"
    ]
    if acquisition.images is None:
        said.append("the number of images is not known")
    if plan.images is not None:
        said.append(f"{plan.images} images")
    if acquisition.keep_s is not None:
        said.append(f"the last {acquisition.keep_s:g} s are kept")
    size, per_hour = acquisition.image_bytes, acquisition.images_per_hour
    if plan.size_bytes is not None:
        said.append(format_bytes(plan.size_bytes))
    elif size is None:
        said.append("size unknown until the cameras are open")
    elif per_hour is not None:
        said.append(f"{format_bytes(round(size * per_hour))} per hour")
    else:
        said.append(f"{size / 1e6:.3g} MB per image of all cameras")
    return "; ".join(said)


def _step_line(planned: PlannedStep) -> str:
    step = planned.step
    target = "" if math.isnan(step.target) else f"{step.target:g} {step.unit}"
    notes = [
        f"at {step.at_s:g} s" if step.timed else "",
        "" if step.images or step.question is not None else "no images",
        "if the specimen demands it" if step.conditional else "",
        "" if step.question is None else f'asks "{step.question.text}", word {step.question.word}',
    ]
    note = ", ".join(filter(None, notes))
    about = format_s(planned.duration_s)
    return f"{step.index:4d}  {step.kind:<12}  {target:<10}  {about:>8}  {note}".rstrip()


def plan_dict(plan: Plan) -> dict[str, Any]:
    """Return the plan as a table for JSON. A value that is unknown or does not apply is None."""
    return {
        "title": plan.title,
        "kind": plan.kind,
        "steps": [
            {
                "index": planned.step.index,
                "kind": planned.step.kind,
                "target": _known(planned.step.target),
                "unit": planned.step.unit,
                "conditional": planned.step.conditional,
                "at_s": _known(planned.step.at_s),
                "images": planned.step.images,
                "question": None if planned.step.question is None else vars(planned.step.question),
                "duration_s": planned.duration_s,
            }
            for planned in plan.steps
        ],
        "duration_s": plan.duration_s,
        "images": plan.images,
        "size_bytes": plan.size_bytes,
        "acquisition": None if plan.acquisition is None else _acquisition_dict(plan.acquisition),
        "worst_load_n": _known(plan.worst_load_n),
        "worst_displacement_mm": _known(plan.worst_displacement_mm),
        "least_load_n": plan.least_load_n,
        "least_displacement_mm": plan.least_displacement_mm,
        "limits": plan.limits.table.rows(),
        "mounting": plan.mounting.model_dump(),
        "objections": plan.objections,
        "cautions": plan.cautions,
    }


def _acquisition_dict(acquisition: AcquisitionPlan) -> dict[str, Any]:
    return {
        "text": acquisition.text,
        "images": acquisition.images,
        "images_per_hour": acquisition.images_per_hour,
        "bytes_per_image": acquisition.image_bytes,
        "keep_s": acquisition.keep_s,
    }


def images_text(plan: Plan) -> str:
    """Return the number and the size of a plan's images as text."""
    if plan.images is None:
        return "images: as the rig has cameras"
    size = plan.size_bytes
    shown = "size unknown until the cameras are open" if size is None else format_bytes(size)
    return f"{plan.images} images, {shown}"


def format_s(duration_s: float | None) -> str:
    """Return a duration as text, in s or minutes."""
    if duration_s is None:
        return "unknown"
    return f"{duration_s:.1f} s" if duration_s < 120.0 else f"{duration_s / 60.0:.1f} min"


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _both_ways(least: float | None, greatest: float) -> str:
    """Return the limit in tension, or those in compression and tension."""
    return f"{greatest:g}" if least is None else f"{least:g} to {greatest:g}"
