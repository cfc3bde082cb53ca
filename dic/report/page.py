"""Write the HTML page of the report on runs; this module selects and orders the content of the page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dic.errors import RunFileError, require_kind
from dic.files.writing import write_text
from dic.keywords import takes_settings
from dic.pipeline.result import RunResult
from dic.report import rotation, tension
from dic.report.calibration import residual_figure
from dic.report.field_pictures import FieldPicture, field_pictures, proof_step
from dic.report.numbers import date, fixed, micro
from dic.report.paper import compare
from dic.report.pdf import require_pdf, write_pdf
from dic.report.series import Run, number_runs
from dic.report.setup import camera_rows, findings, remaining
from dic.report.setup_figures import harmonics_figure, height_figure, height_step, motion_figure
from dic.report.steps import StepTable, camera_tables, pair_table
from dic.report.style import Kind, plot_style, watermark_uri
from dic.report.tables import (
    Remarks,
    calibration_rows,
    problems,
    recommendations,
    series_rows,
    settings_rows,
)
from dic.report.templating import page_templates
from dic.report.tensile_page import tensile_view
from dic.report.tensile_record import TensileTest
from dic.runfile.reader import RunStep
from dic.typing import PathLike

_PROCESS_FIRST = (
    "process the run first, dic.process_run(path), or read its results, dic.load_run_result(path)"
)


@dataclass(frozen=True)
class SetUp:
    """The findings on the set-up of a run, in the form that the page template needs."""

    cameras: list[list[str]]
    findings: list[Remarks]
    remaining: list[str]
    harmonics: str
    motion: str
    heights: str
    heights_step: int


@dataclass(frozen=True)
class ReportView:
    """The content of the report on one run, in the form that the page template needs.

    An attribute for a figure contains a data URI, or an empty text if the run has no such figure.
    """

    run: Run
    problems: list[str]
    settings: list[tuple[str, str]]
    calibrations: list[list[str]]
    recommendations: list[str]
    steps: list[StepTable]
    pair: StepTable | None
    strain: str
    differences: str
    corrected: str
    load: str
    stress: str
    series: list[list[str]]
    setup: SetUp
    residuals: str
    fields: list[FieldPicture]


@takes_settings()
def write_report(
    results: RunResult | Sequence[RunResult],
    path: PathLike,
    *,
    tests: Sequence[TensileTest] = (),
    title: str = "",
    pdf: PathLike | None = None,
) -> None:
    """Write the report of one or several runs as one HTML file with all figures inside.

    The figures of the rotation test show all rotation runs together, as in Helm and Deaner's paper. The
    on-axis camera of a run is the camera named ``on_axis``. If no camera has this name, the on-axis camera is
    the first one. An existing file is replaced only after the new report is complete.

    Parameters
    ----------
    results : RunResult, or sequence of RunResult
        The results of at least one run.
    path : path
        The file to write. An existing file is replaced.
    tests : sequence of TensileTest, optional
        Tensile tests in these runs, from `tensile_test`, whose material properties are shown.
    title : str, optional
        Default: the title of the run, or the number of runs.
    pdf : path, optional
        The same page as a PDF file. This needs the extra ``offaxis[pdf]``.

    Raises
    ------
    RunFileError
        If there is no run, or a file cannot be written.
    OutputError
        If `pdf` is given and WeasyPrint is not installed.
    """
    path = Path(path)
    results = [results] if isinstance(results, RunResult) else results
    require_kind("results", results, Sequence, _PROCESS_FIRST)
    for result in results:
        require_kind("results", result, RunResult, _PROCESS_FIRST)
    if not results:
        raise RunFileError(str(path), "write report", "at least one run", "none", "name a run file")
    if pdf is not None:
        require_pdf(pdf)
    content = _content(number_runs(results), tests, title)
    try:
        write_text(path, _render(content, pdf=False))
        if pdf is not None:
            write_pdf(_render(content, pdf=True), pdf)
    except OSError as error:
        raise RunFileError(
            str(error.filename or path),
            "write report",
            "a folder that can be written to",
            error.strerror or str(error),
            "name another file",
        ) from error


def _render(content: dict[str, Any], *, pdf: bool) -> str:
    environment = page_templates()
    environment.filters |= {"micro": micro, "fixed": fixed, "date": date}
    page: str = environment.get_template("report.html.j2").render(**content, pdf=pdf)
    return page


def _content(runs: list[Run], tests: Sequence[TensileTest], title: str) -> dict[str, Any]:
    """Return what the template of the page needs."""
    turning = [run for run in runs if run.kind == "rotation"]
    with plot_style():
        tensile = [tensile_view(test, [run.result for run in runs]) for test in tests]
        views = [_view(run, proof_step(run, tests)) for run in runs]
        kinds: tuple[Kind, ...] = ("raw", "calibrated", "corrected")
        turns = {kind: rotation.strain_figure(turning, kind) if turning else "" for kind in kinds}
    several = f"Off-axis image correlation: {len(runs)} runs"
    return {
        "title": title or (runs[0].result.info.title if len(runs) == 1 else several),
        "views": views,
        "tensile": tensile,
        "comparisons": compare(runs),
        "turning": turning,
        "rotation": turns,
        "not_corrected": rotation.not_corrected(turning),
        "simulated": any(run.result.info.simulated for run in runs),
        "watermark": watermark_uri("SIMULATED"),
    }


def _view(run: Run, proof: RunStep | None) -> ReportView:
    pulled, on_axis = run.kind == "tension", run.on_axis
    return ReportView(
        run=run,
        problems=problems(run),
        settings=settings_rows(run),
        calibrations=calibration_rows(run),
        recommendations=recommendations(run),
        steps=camera_tables(run) if run.steps else [],
        pair=pair_table(run),
        strain=tension.strain_figure(run) if pulled else "",
        differences=tension.difference_figure(run, on_axis) if pulled and on_axis else "",
        corrected=tension.corrected_difference_figure(run, on_axis) if pulled and on_axis else "",
        load=tension.load_figure(run) if pulled else "",
        stress=tension.stress_figure(run) if pulled and run.is_long else "",
        series=series_rows(run),
        setup=_set_up(run),
        residuals=residual_figure(run.cameras) if run.cameras else "",
        fields=field_pictures(run, proof) if run.kind else [],
    )


def _set_up(run: Run) -> SetUp:
    highest = height_step(run)
    return SetUp(
        cameras=camera_rows(run),
        findings=findings(run),
        remaining=remaining(run),
        harmonics=harmonics_figure(run) if run.kind == "rotation" else "",
        motion=motion_figure(run) if run.kind == "tension" else "",
        heights=height_figure(run),
        heights_step=highest[0].index if highest else 0,
    )
