"""The table that `dic process` prints: raw, calibrated and corrected strains of each step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import starmap
from typing import Any

import numpy as np

import dic
from dic.commands.series_text import strains_of
from dic.commands.strain_table import Column, StrainTable, share_text
from dic.files import by_index, left_out_text, shown

_READINGS = (("load_n", "load N", 0), ("displacement_mm", "displ. mm", 3), ("angle_deg", "angle °", 1))
"""The device readings in the table: attribute of a step, heading, and number of decimals."""
_ALL_IN = "--json and --csv have"


def table(result: dic.pipeline.RunResult) -> str:
    """Return the strains of every step and camera as the text of a table, in microstrain (µε)."""
    lines = [f"{result.info.title} ({result.info.status})"]
    if result.info.simulated:
        lines[0] += " – SIMULATED"
    corrections = result.corrections
    for camera in result.cameras:
        lines += _camera_lines(result, camera)
        lines += [f"  {finding}" for finding in corrections.findings[camera.camera]]
    if corrections.joint is not None:
        lines += _joint_lines(result, corrections.joint)
        lines += [f"  {finding}" for finding in corrections.joint.findings]
    return "\n".join(lines)


def _camera_lines(result: dic.pipeline.RunResult, camera: dic.pipeline.CameraResult) -> list[str]:
    calibration = camera.require_calibration()
    lines = [
        f"{camera.camera}: {calibration.grid.found} of {calibration.grid.expected} grid points,"
        f" residual {calibration.rms_px:.4f} px rms ({calibration.rms_mm * 1e3:.2f} µm)"
        + (f", surface {calibration.plate_mm:g} mm behind the lines" if calibration.plate_mm else "")
        + "".join(
            f", {dic.strain.gauge_text(m.gauge_px, calibration.axes_mm_per_px)}"
            for m in camera.measurements[:1]
        )
    ]
    if not camera.measurements:
        return lines
    timing = dic.pipeline.ImageTiming.of(camera.steps, result.info.definition)
    lines += [f"  {text}" for text in [*([] if timing is None else timing.sentences), *camera.remarks]]
    readings = _readings(camera.steps)
    shares = Column("% points", len("% points"))
    made = StrainTable([*_step_columns(camera.steps, readings), shares])
    lines.append(made.heading())
    images = result.corrections.cameras[camera.camera].images
    declined: dict[str, list[str]] = {}
    printed = shown(len(camera.steps))
    for k, (step, measurement, correction) in enumerate(by_index(camera.steps, camera.measurements, images)):
        if correction.declined is not None:
            declined.setdefault(correction.declined, []).append(_name(step))
        if k in printed:
            summary = measurement.summary() | {"corrected": correction.as_dict()}
            share = share_text(summary)
            lines += made.lines([*_step_cells(step, readings), share], strains_of(summary))
            lines += [f"  {note}" for note in _notes(measurement, summary["remarks"])]
        elif k - 1 in printed:
            lines.append(left_out_text(len(camera.steps), _ALL_IN))
        # Free the memory of this step before the next one is read.
        del measurement, correction
    findings = result.corrections.findings[camera.camera]
    return lines + [
        _declined_text(steps, reason)
        for reason, steps in declined.items()
        if not any(reason in finding for finding in findings)
    ]


def _joint_lines(result: dic.pipeline.RunResult, joint: dic.pipeline.JointCorrections) -> list[str]:
    first, second = joint.cameras
    lines = [f"{first} and {second} together: motion of the specimen's plane by parallax"]
    every = {step.index: step for camera in result.cameras for step in camera.steps}
    steps = [every[index] for index in sorted(joint.steps)]
    readings = _readings(steps)
    made = StrainTable(_step_columns(steps, readings))
    lines.append(made.heading())
    printed = shown(len(steps))
    for k, step in enumerate(steps):
        if k not in printed:
            lines += [left_out_text(len(steps), _ALL_IN)] if k - 1 in printed else []
            continue
        found = joint.steps[step.index]
        cells = _step_cells(step, readings)
        if found.declined or found.mean is None or found.plane is None or found.plane_std is None:
            lines.append(f"{' '.join(cells)}  not corrected: {found.declined}")
            continue
        slopes = np.degrees(np.arctan([found.plane.slope_x, found.plane.slope_y]))
        lines += made.lines(cells, {"corrected": found.mean.as_dict()})
        lines.append(
            f"  shift {1e3 * found.plane.shift_mm:z.2f} ± {1e3 * found.plane_std[2]:.2f} µm,"
            f" slopes x {slopes[0]:z.4f}°, y {slopes[1]:z.4f}°"
        )
    return lines


def _notes(measurement: dic.strain.Measurement, remarks: list[str]) -> list[str]:
    """Return notes about the picture, its smoothing, and new reference images taken up to a step.

    Each new reference increases the standard deviations of the displacements u and v. The text gives these
    standard deviations in mpx.
    """
    field = measurement.field
    notes = [f"images smoothed by {field.smoothing_px:g} px"] if field.smoothing_px > 0.0 else []
    if field.updates and field.converged.any():
        std_px = [1e3 * float(np.median(std[field.converged])) for std in (field.std_u_px, field.std_v_px)]
        notes.append(
            f"over {field.updates} new references: std u {std_px[0]:.1f}, v {std_px[1]:.1f} mpx (median)"
        )
    return notes + remarks


def _declined_text(steps: Sequence[str], reason: str) -> str:
    """Return a text that says which steps were not corrected, and why."""
    which = steps[0] if len(steps) == 1 else f"{len(steps)} steps from {steps[0]} to {steps[-1]}"
    return f"  not corrected, {which}: {reason}"


def _readings(steps: Iterable[dic.runfile.RunStep]) -> list[tuple[str, str, int]]:
    """Return the entries of `_READINGS` for which at least one step has a reading."""
    kept = list(steps)
    return [reading for reading in _READINGS if any(_known(getattr(step, reading[0])) for step in kept)]


def _step_columns(
    steps: Sequence[dic.runfile.RunStep], readings: Sequence[tuple[str, str, int]]
) -> list[Column]:
    cells = [_step_cells(step, readings) for step in steps]
    headings = ["step", *(heading for _, heading, _ in readings)]
    widths = [max(map(len, column)) for column in zip(headings, *cells, strict=True)]
    return [
        Column(heading, width, number=heading != "step")
        for heading, width in zip(headings, widths, strict=True)
    ]


def _step_cells(step: dic.runfile.RunStep, readings: Sequence[tuple[str, str, int]]) -> list[str]:
    values = [(getattr(step, name), digits) for name, _, digits in readings]
    return [_name(step), *(f"{value:.{digits}f}" if _known(value) else "" for value, digits in values)]


def _name(step: dic.runfile.RunStep) -> str:
    return f"{step.kind} {step.index}"


def _known(value: float) -> bool:
    return value == value


def as_dict(result: dic.pipeline.RunResult) -> dict[str, Any]:
    """Return a run's strains as a dictionary for JSON; `docs/results.md` describes the keys."""
    cameras = {}
    for camera in result.cameras:
        corrections = result.corrections.cameras[camera.camera]
        steps = starmap(_step_as_dict, by_index(camera.steps, camera.measurements, corrections.images))
        calibration = camera.require_calibration()
        timing = dic.pipeline.ImageTiming.of(camera.steps, result.info.definition)
        cameras[camera.camera] = {
            "calibration": {
                "found": calibration.grid.found,
                "expected": calibration.grid.expected,
                "rms_px": calibration.rms_px,
                "max_px": calibration.max_px,
                "rms_mm": calibration.rms_mm,
                "plate_mm": calibration.plate_mm,
            },
            "alignment": None if corrections.alignment is None else corrections.alignment.as_dict(),
            "findings": result.corrections.findings[camera.camera],
            "remarks": list(camera.remarks),
            "timing": None if timing is None else timing.as_dict(),
            "steps": list(steps),
            "failures": camera.failures,
        }
    info = result.info
    return {
        "run": result.source,
        "title": info.title,
        "status": info.status,
        "simulated": info.simulated,
        "sample": info.sample,
        "direction_deg": info.direction_deg,
        "settings": vars(result.settings),
        "motion": result.corrections.motion,
        "shift": result.correcting.shift.as_dict(),
        "cameras": cameras,
        "both": None if result.corrections.joint is None else _joint_as_dict(result.corrections.joint),
    }


def _step_as_dict(
    step: dic.runfile.RunStep,
    measurement: dic.strain.Measurement,
    correction: dic.out_of_plane.Correction,
) -> dict[str, Any]:
    readings = {k: None if v != v else v for k, v in step.known().items()}
    summary = measurement.summary() | {"corrected": correction.as_dict()}
    return readings | summary | {"good": measurement.good}


def _joint_as_dict(joint: dic.pipeline.JointCorrections) -> dict[str, Any]:
    steps = []
    for index, found in sorted(joint.steps.items()):
        plane = found.corrections[0].as_dict()
        shape = {name: value for name, value in plane.items() if name.startswith(("slope", "shift"))}
        mean = {} if found.mean is None else found.mean.as_dict()
        applied = {"applied": found.declined is None, "reason": found.declined}
        steps.append({"index": index} | mean | shape | applied)
    return {"cameras": list(joint.cameras), "steps": steps, "findings": joint.findings}
