"""`dic process`: run files in, results and the paper's table out."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.commands.strain_options import strain_options

if TYPE_CHECKING:
    from dic.measurement import Measurement
    from dic.process import RunResult

_FILE = click.Path(path_type=Path)
_STRAINS = ("exx", "eyy", "exy")


@click.command()
@click.argument("run", type=_FILE)
@click.option("-o", "--output", type=_FILE, help="Result file. Default: RUN with the ending .results.h5.")
@click.option("--report", "report_file", type=_FILE, help="Also write the report, one HTML file.")
@click.option("--subset", default=31, show_default=True, help="Width of the subsets, odd, px.")
@click.option("--step", default=10, show_default=True, help="Distance of the points, px.")
@click.option(
    "--incremental",
    default="auto",
    show_default=True,
    help="New reference: auto (when the correlation drops), never, or always (each image before).",
)
@strain_options
@click.option("--json", "json_file", type=_FILE, help="What is printed, for programs.")
@click.pass_context
def process(
    context: click.Context,
    run: Path,
    output: Path | None,
    report_file: Path | None,
    subset: int,
    step: int,
    incremental: str,
    strain_measure: str,
    strain_window: int,
    strain_from: str,
    json_file: Path | None,
) -> None:
    """Calibrate every camera of a RUN file, correlate every step, and give its strains.

    Status: 0, 1 if a step was measured badly, 2 if one could not be measured.
    """
    from dic.commands.console import counted_progress, fail, say
    from dic.commands.places import require_places
    from dic.process import process_run
    from dic.report import write_report
    from dic.run_results import save_run_result
    from dic.settings import CorrelationSettings
    from dic.strain import StrainSettings

    settings = CorrelationSettings(subset_px=subset, step_px=step)
    strain = StrainSettings(measure=strain_measure, window_points=strain_window, source=strain_from)
    output = output or run.with_suffix(".results.h5")
    require_places([run], [output, report_file, json_file])
    with counted_progress("correlating") as (on_count, on_image):
        result = process_run(
            run, settings, strain, incremental=incremental, on_image=on_image, on_count=on_count
        )
    save_run_result(result, output)
    say(table(result))
    say(f"results: {output}")
    if report_file is not None:
        write_report([result], report_file)
        say(f"report: {report_file}")
    if json_file is not None:
        json_file.write_text(json.dumps(as_dict(result), indent=1), encoding="utf-8")
    failures = [failure for camera in result.cameras for failure in camera.failures]
    bad = [
        f"{run}: {camera.camera}, {measurement.label}: measured, but {measurement.objection}"
        for camera in result.cameras
        for measurement in camera.measurements
        if not measurement.good
    ]
    for sentence in failures + bad:
        fail(sentence)
    context.exit(2 if failures else 1 if bad else 0)


def table(result: "RunResult") -> str:
    """Return the strains of every step and camera as the paper tabulates them, in µε."""
    from dic.strain import gauge_text

    lines = [f"{result.info.title} ({result.info.status})"]
    if result.info.simulated:
        lines[0] += " – SIMULATED"
    for camera in result.cameras:
        rms_um, calibration = camera.calibration.rms_mm * 1e3, camera.calibration
        lines.append(
            f"{camera.camera}: {calibration.grid.found} of {calibration.grid.expected} grid points,"
            f" residual {calibration.rms_px:.4f} px rms ({rms_um:.2f} µm)"
            + "".join(f", {gauge_text(m.gauge_px, m.gauge_mm)}" for m in camera.measurements[:1])
        )
        lines.append(f"{'step':>14} {'load':>9} {'displ.':>8} {'angle':>7} {'points':>6}" + _heading())
        for step, measurement in zip(camera.steps, camera.measurements, strict=True):
            calibrated = measurement.calibrated_mean or measurement.raw_mean
            cells = [f"{step.kind + ' ' + str(step.index):>14}", _cell(step.load_n, 9, "N")]
            cells += [_cell(step.displacement_mm, 8, "mm"), _cell(step.angle_deg, 7, "°")]
            cells.append(f"{calibrated.points:6d}")
            for mean in (measurement.raw_mean, calibrated):
                cells += [f"{1e6 * getattr(mean, name):8.0f}" for name in _STRAINS]
            lines.append(" ".join(cells) + _updates(measurement))
    return "\n".join(lines)


def as_dict(result: "RunResult") -> dict[str, Any]:
    """Return a run's strains for programs, JSON-ready; the layout is in `docs/results.md`."""
    cameras = {}
    for camera in result.cameras:
        steps = []
        for step, measurement in zip(camera.steps, camera.measurements, strict=True):
            readings = {k: None if v != v else v for k, v in vars(step).items()}
            steps.append(readings | measurement.summary() | {"good": measurement.good})
        calibration = camera.calibration
        cameras[camera.camera] = {
            "calibration": {
                "found": calibration.grid.found,
                "expected": calibration.grid.expected,
                "rms_px": calibration.rms_px,
                "max_px": calibration.max_px,
                "rms_mm": calibration.rms_mm,
            },
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
        "cameras": cameras,
    }


def _updates(measurement: "Measurement") -> str:
    """Return over how many new references a step was measured, and the error that has added up, if any."""
    import numpy as np

    field = measurement.field
    if not field.updates or not field.converged.any():
        return ""
    std_px = [1e3 * float(np.median(std[field.converged])) for std in (field.std_u_px, field.std_v_px)]
    return f"  over {field.updates} new references: std u {std_px[0]:.1f}, v {std_px[1]:.1f} mpx"


def _heading() -> str:
    return "".join(f" {kind + ' ' + name:>8}" for kind in ("raw", "cal.") for name in _STRAINS) + "  µε"


def _cell(value: float, width: int, unit: str) -> str:
    if value != value:
        return " " * (width - 1) + "–"
    digits = {"N": 0, "mm": 3, "°": 1}[unit]
    return f"{value:{width}.{digits}f}"
