"""The command `dic report`, which writes one HTML page from result files."""

from pathlib import Path

import click

from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places

_FILE = click.Path(path_type=Path)


@click.command()
@click.argument("results", type=_FILE, nargs=-1, required=True)
@click.option("-o", "--output", type=_FILE, default=Path("report.html"), show_default=True)
@FORCE
def report(results: tuple[Path, ...], output: Path, force: bool) -> None:
    """Write one self-contained HTML report from RESULTS.

    RESULTS are the result files of one or more runs, from `dic process`, or of one or more series of images,
    from `dic correlate`.
    """
    from dic import MeasurementError, RunFileError, load_run_result, write_report
    from dic.pipeline.series_result_file import is_series_result, load_series_result
    from dic.report.series_page import write_series_report

    require_places(results, [output], force=force)
    series = [path for path in results if is_series_result(path)]
    if series and len(series) < len(results):
        raise RunFileError(
            str(series[0]),
            "write report",
            "runs alone, or series of images alone",
            "a series beside a run",
            "write a report of each",
        )
    try:
        if series:
            write_series_report([load_series_result(path) for path in series], output)
        else:
            write_report([load_run_result(path) for path in results], output)
    except (MeasurementError, OSError):
        raise
    except Exception as error:
        # A file can be read and still contradict itself, for example with maps of different sizes.
        raise RunFileError(
            ", ".join(map(str, results)),
            "write report",
            "results that fit together",
            f"some that do not ({type(error).__name__}: {' '.join(str(error).split())[:200]})",
            "make them again with `dic process` or `dic correlate`",
        ) from error
    say(f"report: {output}")
