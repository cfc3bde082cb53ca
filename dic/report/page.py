"""The page: what it shows in which order, and the file it becomes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dic.errors import RunFileError
from dic.process import RunResult
from dic.report import rotation, tension
from dic.report.calibration import residual_figure
from dic.report.fields import FieldPicture, field_pictures
from dic.report.numbers import date, fixed, micro
from dic.report.paper import compare
from dic.report.series import Run, number_runs
from dic.report.style import plot_style, watermark_uri
from dic.report.tables import StepRow, calibration_rows, problems, settings_rows, step_rows


@dataclass(frozen=True)
class RunView:
    """One run as the template shows it; the figures are data URIs, empty where a run has no such figure."""

    run: Run
    problems: list[str]
    settings: list[tuple[str, str]]
    calibrations: list[list[str]]
    steps: list[StepRow]
    strain: str
    differences: str
    load: str
    residuals: str
    fields: list[FieldPicture]


def write_report(results: Sequence[RunResult], path: Path) -> None:
    """Write the report of one or several runs as one HTML file that needs nothing else.

    Runs of the rotation test are shown together, as in the paper. The on-axis camera is the one named
    ``on_axis``, else the first of a run. A report is written whole or not at all.

    Parameters
    ----------
    results : sequence of RunResult
        At least one.
    path : Path
        The file to write; an existing one is replaced.

    Raises
    ------
    RunFileError
        If there is no run, or the file cannot be written.
    """
    if not results:
        raise RunFileError(
            str(path), "write report", expected="at least one run", got="none", remedy="name a run file"
        )
    page = _render(number_runs(results))
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(page, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise RunFileError(
            str(path),
            "write report",
            expected="a folder that can be written to",
            got=error.strerror or str(error),
            remedy="name another file",
        ) from error


def _render(runs: list[Run]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("dic.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"micro": micro, "fixed": fixed, "date": date}
    turning = [run for run in runs if run.kind == "rotation"]
    with plot_style():
        views = [_view(run) for run in runs]
        raw, calibrated = (rotation.strain_figure(turning, c) if turning else "" for c in (False, True))
    return environment.get_template("report.html.j2").render(
        title=runs[0].result.info.title
        if len(runs) == 1
        else f"Off-axis image correlation: {len(runs)} runs",
        views=views,
        comparisons=compare(runs),
        turning=turning,
        rotation_raw=raw,
        rotation_calibrated=calibrated,
        simulated=any(run.result.info.simulated for run in runs),
        watermark=watermark_uri("SIMULATED"),
    )


def _view(run: Run) -> RunView:
    pulled = run.kind == "tension"
    return RunView(
        run=run,
        problems=problems(run),
        settings=settings_rows(run),
        calibrations=calibration_rows(run),
        steps=step_rows(run),
        strain=tension.strain_figure(run) if pulled else "",
        differences=tension.difference_figure(run, run.on_axis) if pulled and run.on_axis else "",
        load=tension.load_figure(run) if pulled else "",
        residuals=residual_figure(run.result.cameras) if run.result.cameras else "",
        fields=field_pictures(run) if run.kind else [],
    )
