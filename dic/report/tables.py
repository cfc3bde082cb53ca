"""The report's tables: settings, calibrations and problems."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from dic.correlation.settings import CorrelationSettings
from dic.files.shortened import some_sentences
from dic.pipeline.image_timing import ImageTiming
from dic.report.numbers import date, direction_text, fixed
from dic.report.series import CameraSeries, Run
from dic.runfile.reader import RunInfo
from dic.strain.measurement import Measurement
from dic.strain.measures import MEASURES
from dic.strain.strain import gauge_text

SOURCES = {
    "fit": "plane fitted to {0} × {0} points",
    "quadratic-fit": "quadratic surface fitted to {0} × {0} points",
    "shape": "gradient of the shape function",
}
"""How a local strain is computed, with a place for the width of the window."""
_MODELS = {
    "bicubic": "the paper's bicubic map of 2 × 16 parameters",
    "pinhole": "a pinhole camera with lens distortion",
}
_MOTIONS = {
    "rigid": "for a rigid rotation about a fixed axis",
    "tension": "for uniform strain and bending in a plane that tilts",
    "free": "none: the steps tell no motion",
}
ALL_IN = "`dic process --csv FOLDER --json FILE` writes"
"""What has all steps of a run of which the report shows a part."""
_USES = (("in use", "model"), ("recommended", "recommended"))
"""Purposes of a calibration model, such as "in use", and the attributes of `Calibration` that name it."""


@dataclass(frozen=True)
class Remarks:
    """Sentences on the results of one camera, of two cameras together, or of one column of a table."""

    label: str
    sentences: list[str]


def calibration_rows(run: Run) -> list[list[str]]:
    """Return the rows of the table of calibrations, as text, one row per camera and model.

    The columns are: camera; number of points; model and its purpose; scale in µm per px; rms residual in px
    and in µm; largest residual in px and in µm; rms residual of the cross-validation in px.
    """
    rows = []
    for series in run.cameras:
        calibration, pinhole = series.calibration, series.calibration.pinhole
        cross_validation_px = {"bicubic": calibration.bicubic_cross_validation_px}
        if pinhole is not None:
            cross_validation_px["pinhole"] = pinhole.cross_validation_px
        for model, residuals in calibration.residuals.items():
            use = [word for word, which in _USES if getattr(calibration, which) == model]
            rows.append(
                [
                    series.label,
                    f"{calibration.grid.found} of {calibration.grid.expected}",
                    model + (f" ({', '.join(use)})" if use else ""),
                    fixed(calibration.using(model).mm_per_px * 1000, 3),
                    fixed(residuals.rms_px, 4),
                    fixed(residuals.rms_mm * 1000, 3),
                    fixed(residuals.max_px, 4),
                    fixed(residuals.max_mm * 1000, 3),
                    fixed(cross_validation_px[model], 4),
                ]
            )
    return rows


def recommendations(run: Run) -> list[str]:
    """Return one sentence per camera that names the recommended calibration model and the reason."""
    return [f"{series.label}: {series.calibration.recommendation}." for series in run.cameras]


def settings_rows(run: Run) -> list[tuple[str, str]]:
    """Return the names and values of the run's properties and settings, as text."""
    result, info, settings = run.result, run.result.info, run.result.settings
    rows = [
        ("Run", f"{info.run_id}, begun {date(info.start_time)}"),
        ("Run file", Path(result.source).name),
        ("Specimen", info.sample),
        ("Gauge section", gauge_section(info)),
        *([] if info.direction_deg is None else [("Direction", direction_text(info.direction_deg))]),
        *correlation_rows(settings),
        (
            "Convergence",
            f"{settings.tolerance_px:g} px at a subset's edge, at most {settings.max_iterations} iterations",
        ),
    ]
    rows += _strain_rows(run)
    rows += _calibration_settings(run)
    rows += [(f"Times of images, {name}", timing.text) for name, timing in _timings(run).items()]
    rows.append(("Correction", f"{_MOTIONS[result.corrections.motion]}; {_poisson(run)}"))
    if result.corrections.motion == "tension":
        rows.append(("Shift towards the camera", result.correcting.shift.text))
    starts = sorted({image.start for camera in run.cameras for image in camera.outlines})
    if starts:
        rows.append(("First guesses from", ", ".join(starts)))
    rows.append(("Versions", ", ".join(info.versions.splitlines())))
    if result.provenance is not None:
        rows.append(("Results by", f"{result.provenance.command} ({result.provenance.versions})"))
        inputs = result.provenance.inputs.items()
        rows += [("Input", f"{Path(file).name}, SHA-256 {digest}") for file, digest in inputs]
    return rows


def gauge_section(info: RunInfo) -> str:
    """Return the size of the specimen in words; a protocol need not state it."""
    sizes = (info.width_mm, "wide"), (info.thickness_mm, "thick"), (info.gauge_length_mm, "long")
    return ", ".join(f"{size:g} mm {word}" for size, word in sizes if isfinite(size)) or "not stated"


def correlation_rows(settings: CorrelationSettings) -> list[tuple[str, str]]:
    """Return the names and values of the settings of a correlation, as text."""
    return [
        ("Subset", f"{settings.subset_px} px, step {settings.step_px} px, {settings.shape} shape function"),
        ("Interpolation", f"B-spline of order {settings.order}"),
        ("Correlation", f"IC-GN on ZNSSD, at least {settings.min_zncc:g} ZNCC"),
    ]


def _calibration_settings(run: Run) -> list[tuple[str, str]]:
    calibrations = [camera.calibration for camera in run.cameras]
    grids = {(c.grid.lines, c.grid.pitch_mm) for c in calibrations}
    rows = [
        ("Calibration grid", f"{across} × {up} lines, {pitch_mm:g} mm pitch")
        for (across, up), pitch_mm in sorted(grids)
    ]
    models = {
        f"{_MODELS[c.model]}" + (f", camera from {c.images} images" if c.images > 1 else "")
        for c in calibrations
    }
    rows += [
        ("Specimen's surface", f"{plate_mm:g} mm behind the grid's lines")
        for plate_mm in sorted({c.plate_mm for c in calibrations if c.plate_mm})
    ]
    return rows + [("Calibrated strain by", text) for text in sorted(models)]


def _poisson(run: Run) -> str:
    correcting = run.result.correcting
    if run.result.corrections.motion == "tension":
        return f"Poisson's ratio {correcting.poisson_ratio:g}, for bending"
    known = [camera.camera for camera in run.cameras if camera.camera in correcting.alignments]
    return f"alignment of an earlier rotation for {', '.join(known)}" if known else "from this run alone"


def _strain_rows(run: Run) -> list[tuple[str, str]]:
    rows = []
    # All images of a series have the same settings, so it is enough to read one image.
    firsts = [m for camera in run.cameras for m in camera.measurements[:1]]
    for measure in sorted({m.strain_settings.measure for m in firsts}):
        name = MEASURES[measure].title
        rows.append(("Strain", f"{name}, axes X right and Y up; mean: plane fitted to all valid points"))
    for series in run.cameras:
        scale = series.calibration.axes_mm_per_px
        for gauge in sorted({_gauge(m, scale) for m in series.measurements[:1]}):
            rows.append((f"Local strain, {series.camera}", gauge))
    return rows


def _gauge(measurement: Measurement, axes_mm_per_px: tuple[float, float]) -> str:
    settings = measurement.strain_settings
    source = SOURCES[settings.source].format(settings.window_points)
    gauge = gauge_text(measurement.gauge_px, axes_mm_per_px)
    return f"{source}: {gauge}, {resolution_text(measurement)}"


def resolution_text(measurement: Measurement) -> str:
    """Return the spatial resolution of local strain in words."""
    wave = f"a strain wave with a period of {measurement.resolution_px:.0f} px"
    return f"keeps 90 % of the amplitude of {wave}"


def problems(run: Run) -> list[str]:
    """Return one sentence for each problem of the run that readers must know before they use the results."""
    info = run.result.info
    sentences = []
    if info.status != "completed":
        reason = f": {info.status_reason}" if info.status_reason else ""
        sentences.append(f"The run did not complete; its status is “{info.status}”{reason}")
    if not run.kind:
        sentences.append("No step of this run could be measured.")
    sentences += [
        f"{name}: {timing.text}; each image has the time at which it was exposed."
        for name, timing in _timings(run).items()
        if timing.is_late
    ]
    for camera in run.cameras:
        sentences += _camera_problems(camera)
    return sentences


def series_rows(run: Run) -> list[list[str]]:
    """Return the rows of the table of images of a run, as text, one row per camera; empty for a short run.

    The columns are: camera; number of images; asked and reached rate in images per second; late images;
    missing images; images that could not be measured.
    """
    if not run.is_long:
        return []
    rows, timings = [], _timings(run)
    for camera in run.cameras:
        timing, failed = timings.get(camera.camera), len(camera.result.failures)
        known = ["–"] * 4
        if timing is not None:
            rates = [_rate(timing.asked_interval_s), _rate(timing.reached_interval_s)]
            known = [*rates, str(timing.late), "–" if timing.missing is None else str(timing.missing)]
        rows.append([camera.label, str(len(camera.steps) + failed), *known, str(failed)])
    return rows


def _rate(interval_s: float | None) -> str:
    return "–" if not interval_s else f"{1.0 / interval_s:.4g}"


def _timings(run: Run) -> dict[str, ImageTiming]:
    """Return the timing of each camera whose images were due at times."""
    found = {each.camera: ImageTiming.of(each.steps, run.result.info.definition) for each in run.cameras}
    return {name: timing for name, timing in found.items() if timing is not None}


def _camera_problems(camera: CameraSeries) -> list[str]:
    grid = camera.calibration.grid
    sentences = [f"{camera.camera}, calibration grid: {warning}" for warning in grid.warnings]
    if grid.found < grid.expected:
        sentences.append(f"{camera.camera}: {grid.found} of {grid.expected} grid points were found.")
    sentences += [f"{camera.camera}: {remark}." for remark in camera.result.remarks]
    of_steps = [
        f"{camera.camera}, step {step.index}: {image.objection}."
        for step, image in zip(camera.steps, camera.outlines, strict=True)
        if image.objection is not None
    ]
    return sentences + some_sentences([*camera.result.failures, *of_steps], ALL_IN)
