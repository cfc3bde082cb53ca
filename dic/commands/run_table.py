"""The table that `dic process` prints: raw, calibrated and corrected strains of each step."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from dic import CameraResult, JointCorrections, MeanStrain, Measurement, RunResult, RunStep

_STRAINS = ("exx", "eyy", "exy")


def table(result: "RunResult") -> str:
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


def _camera_lines(result: "RunResult", camera: "CameraResult") -> list[str]:
    from dic import gauge_text

    calibration = camera.calibration
    lines = [
        f"{camera.camera}: {calibration.grid.found} of {calibration.grid.expected} grid points,"
        f" residual {calibration.rms_px:.4f} px rms ({calibration.rms_mm * 1e3:.2f} µm)"
        + "".join(f", {gauge_text(m.gauge_px, m.gauge_mm)}" for m in camera.measurements[:1]),
        _step_heading() + _strain_heading("raw", "cal.", "corr.") + "  µε",
    ]
    images = result.corrections.cameras[camera.camera].images
    for step, measurement, correction in zip(camera.steps, camera.measurements, images, strict=True):
        calibrated = measurement.calibrated_mean or measurement.raw_mean
        corrected = None if correction.declined else correction.mean
        cells = [_step_cells(step, calibrated.points)]
        cells += [_strain_cells(mean) for mean in (measurement.raw_mean, calibrated, corrected)]
        lines.append(" ".join(cells) + _updates(measurement))
    return lines


def _joint_lines(result: "RunResult", joint: "JointCorrections") -> list[str]:
    first, second = joint.cameras
    lines = [
        f"{first} and {second} together: motion of the specimen's plane by parallax",
        _step_heading() + _strain_heading("corr.") + f" {'± exx':>6} {'± eyy':>6} {'± exy':>6}"
        f"  µε {'shift':>8} {'±':>5} µm {'slope x':>8} {'slope y':>8} °",
    ]
    steps = {step.index: step for camera in result.cameras for step in camera.steps}
    for index, found in sorted(joint.steps.items()):
        if found.declined or found.mean is None or found.plane is None or found.plane_std is None:
            lines.append(_step_cells(steps[index], 0) + f"  not corrected: {found.declined}")
            continue
        slopes = np.degrees(np.arctan([found.plane.slope_x, found.plane.slope_y]))
        stds = " ".join(f"{1e6 * getattr(found.mean, f'{name}_std'):6.0f}" for name in _STRAINS)
        lines.append(
            f"{_step_cells(steps[index], found.mean.points)} {_strain_cells(found.mean)} {stds}"
            f"     {1e3 * found.plane.shift_mm:z8.2f} {1e3 * found.plane_std[2]:5.2f}   "
            f" {slopes[0]:z8.4f} {slopes[1]:z8.4f}"
        )
    return lines


def _updates(measurement: "Measurement") -> str:
    """Return a text about smoothing and about new reference images up to a step, with the errors they cause.

    Each new reference increases the standard deviations of the displacements u and v, which the text gives in
    mpx. The text is empty if images were not smoothed and the first reference is still in use.
    """
    field = measurement.field
    smoothed = f"  smoothed by {field.smoothing_px:g} px" if field.smoothing_px > 0.0 else ""
    if not field.updates or not field.converged.any():
        return smoothed
    std_px = [1e3 * float(np.median(std[field.converged])) for std in (field.std_u_px, field.std_v_px)]
    return f"{smoothed}  over {field.updates} new references: std u {std_px[0]:.1f}, v {std_px[1]:.1f} mpx"


def _step_heading() -> str:
    return f"{'step':>14} {'load':>9} {'displ.':>8} {'angle':>7} {'points':>6}"


def _strain_heading(*kinds: str) -> str:
    return "".join(f" {kind + ' ' + name:>9}" for kind in kinds for name in _STRAINS)


def _step_cells(step: "RunStep", points: int) -> str:
    cells = [f"{step.kind + ' ' + str(step.index):>14}", _cell(step.load_n, 9, "N")]
    cells += [_cell(step.displacement_mm, 8, "mm"), _cell(step.angle_deg, 7, "°"), f"{points:6d}"]
    return " ".join(cells)


def _strain_cells(mean: "MeanStrain | None") -> str:
    if mean is None:
        return " ".join([" " * 8 + "–"] * len(_STRAINS))
    return " ".join(f"{1e6 * getattr(mean, name):z9.0f}" for name in _STRAINS)


def _cell(value: float, width: int, unit: str) -> str:
    if value != value:
        return " " * (width - 1) + "–"
    digits = {"N": 0, "mm": 3, "°": 1}[unit]
    return f"{value:{width}.{digits}f}"


def as_dict(result: "RunResult") -> dict[str, Any]:
    """Return a run's strains as a dictionary for JSON; `docs/results.md` describes the keys."""
    cameras = {}
    for camera in result.cameras:
        steps = []
        corrections = result.corrections.cameras[camera.camera]
        for step, measurement, correction in zip(
            camera.steps, camera.measurements, corrections.images, strict=True
        ):
            readings = {k: None if v != v else v for k, v in vars(step).items()}
            summary = measurement.summary() | {"corrected": correction.as_dict()}
            steps.append(readings | summary | {"good": measurement.good})
        calibration = camera.calibration
        cameras[camera.camera] = {
            "calibration": {
                "found": calibration.grid.found,
                "expected": calibration.grid.expected,
                "rms_px": calibration.rms_px,
                "max_px": calibration.max_px,
                "rms_mm": calibration.rms_mm,
            },
            "alignment": None if corrections.alignment is None else corrections.alignment.as_dict(),
            "findings": result.corrections.findings[camera.camera],
            "steps": steps,
            "failures": camera.failures,
        }
    info = result.info
    return {
        "run": result.source,
        "title": info.title,
        "status": info.status,
        "simulated": info.simulated,
        "settings": vars(result.settings),
        "motion": result.corrections.motion,
        "cameras": cameras,
        "both": None if result.corrections.joint is None else _joint_as_dict(result.corrections.joint),
    }


def _joint_as_dict(joint: "JointCorrections") -> dict[str, Any]:
    steps = []
    for index, found in sorted(joint.steps.items()):
        plane = found.corrections[0].as_dict()
        shape = {name: value for name, value in plane.items() if name.startswith(("slope", "shift"))}
        mean = {} if found.mean is None else found.mean.as_dict()
        applied = {"applied": found.declined is None, "reason": found.declined}
        steps.append({"index": index} | mean | shape | applied)
    return {"cameras": list(joint.cameras), "steps": steps, "findings": joint.findings}
