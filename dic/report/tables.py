"""The report's tables: settings, calibrations, steps, and what went wrong."""

from dataclasses import dataclass
from pathlib import Path

from dic.process import CameraResult
from dic.report.numbers import date, fixed
from dic.report.series import Float, Run
from dic.run_file import RunStep
from dic.strain import gauge_text

_MEASURES = {
    "green-lagrange": "Green–Lagrange",
    "small": "Small (engineering)",
    "hencky": "Hencky (logarithmic)",
}
_UNITS = {"load": "N", "displacement": "mm", "rotation": "°"}


@dataclass(frozen=True)
class CameraCell:
    """What one camera measured at one step: strains in µε, from how many points of all in view."""

    points: int
    in_view: int
    raw: Float
    calibrated: Float


@dataclass(frozen=True)
class StepRow:
    """One step of the full table; a camera that could not measure it has None."""

    step: RunStep
    target: str
    cells: list[CameraCell | None]


def step_rows(run: Run) -> list[StepRow]:
    """Return the full table of a run."""
    rows = []
    for step in run.steps:
        cells: list[CameraCell | None] = []
        for series, camera in zip(run.cameras, run.result.cameras, strict=True):
            at = next((k for k, s in enumerate(camera.steps) if s.index == step.index), None)
            if at is None:
                cells.append(None)
                continue
            measurement = camera.measurements[at]
            points, in_view = measurement.raw_mean.points, measurement.field.in_view
            cells.append(CameraCell(points, in_view, series.raw[at], series.calibrated[at]))
        rows.append(StepRow(step, f"{step.target:.6g} {_UNITS.get(step.kind, '')}".rstrip(), cells))
    return rows


def calibration_rows(run: Run) -> list[list[str]]:
    """Return one row per camera: name, points, scale, rms and largest residual in px and µm."""
    return [
        [
            series.label,
            f"{camera.calibration.grid.found} of {camera.calibration.grid.expected}",
            fixed(camera.calibration.mm_per_px * 1000, 3),
            fixed(camera.calibration.rms_px, 4),
            fixed(camera.calibration.rms_mm * 1000, 3),
            fixed(camera.calibration.max_px, 4),
            fixed(camera.calibration.max_mm * 1000, 3),
        ]
        for series, camera in zip(run.cameras, run.result.cameras, strict=True)
    ]


def settings_rows(run: Run) -> list[tuple[str, str]]:
    """Return names and values of what was set, in words."""
    result, info, settings = run.result, run.result.info, run.result.settings
    rows = [
        ("Run", f"{info.run_id}, begun {date(info.start_time)}"),
        ("Run file", Path(result.source).name),
        ("Specimen", info.sample),
        (
            "Gauge section",
            f"{info.width_mm:g} mm wide, {info.thickness_mm:g} mm thick, {info.gauge_length_mm:g} mm long",
        ),
        ("Subset", f"{settings.subset_px} px, step {settings.step_px} px, {settings.shape} shape function"),
        ("Interpolation", f"B-spline of order {settings.order}"),
        ("Correlation", f"IC-GN on ZNSSD, at least {settings.min_zncc:g} ZNCC"),
        (
            "Convergence",
            f"{settings.tolerance_px:g} px at a subset's edge, at most {settings.max_iterations} iterations",
        ),
    ]
    rows += _strain_rows(run)
    grids = {(c.calibration.grid.lines, c.calibration.grid.pitch_mm) for c in result.cameras}
    rows += [
        (
            "Calibration grid",
            f"{across} × {up} lines, {pitch_mm:g} mm pitch; bicubic map of 2 × 16 parameters",
        )
        for (across, up), pitch_mm in sorted(grids)
    ]
    starts = sorted({m.field.start for camera in result.cameras for m in camera.measurements})
    if starts:
        rows.append(("First guesses from", ", ".join(starts)))
    rows.append(("Versions", ", ".join(info.versions.splitlines())))
    return rows


def _strain_rows(run: Run) -> list[tuple[str, str]]:
    rows = []
    measurements = [m for camera in run.result.cameras for m in camera.measurements]
    for measure in sorted({m.strain_settings.measure for m in measurements}):
        name = _MEASURES[measure]
        rows.append(("Strain", f"{name}, axes X right and Y up; mean: plane fitted to all valid points"))
    gauges = {(m.strain_settings, gauge_text(m.gauge_px, m.gauge_mm)) for m in measurements}
    for settings, gauge in sorted(gauges, key=str):
        window = settings.window_points
        source = {
            "fit": f"plane fitted to {window} × {window} points",
            "quadratic-fit": f"quadratic surface fitted to {window} × {window} points",
            "shape": "gradient of the shape function",
        }[settings.source]
        rows.append(("Local strain", f"{source}: {gauge}"))
    return rows


def problems(run: Run) -> list[str]:
    """Return one sentence for everything that a reader must know before trusting the run."""
    info = run.result.info
    sentences = []
    if info.status != "completed":
        reason = f": {info.status_reason}" if info.status_reason else ""
        sentences.append(f"The run did not complete; its status is “{info.status}”{reason}")
    if not run.kind:
        sentences.append("No step of this run could be measured.")
    for camera in run.result.cameras:
        sentences += _camera_problems(camera)
    return sentences


def _camera_problems(camera: CameraResult) -> list[str]:
    grid = camera.calibration.grid
    sentences = [f"{camera.camera}, calibration grid: {warning}" for warning in grid.warnings]
    if grid.found < grid.expected:
        sentences.append(f"{camera.camera}: {grid.found} of {grid.expected} grid points were found.")
    sentences += camera.failures
    sentences += [
        f"{camera.camera}, step {step.index}: fewer than half of the points in view converged."
        for step, measurement in zip(camera.steps, camera.measurements, strict=True)
        if not measurement.good
    ]
    return sentences
