"""`dic report`: writes one HTML page from result files."""

from pathlib import Path

import click

_FILE = click.Path(path_type=Path)


@click.command()
@click.argument("results", type=_FILE, nargs=-1, required=True)
@click.option("-o", "--output", type=_FILE, default=Path("report.html"), show_default=True)
def report(results: tuple[Path, ...], output: Path) -> None:
    """Write one self-contained HTML report of the RESULTS of one or more runs, from `dic process`."""
    from dic import load_run_result, write_report
    from dic.shell.output_paths import require_places

    require_places(results, [output])
    write_report([load_run_result(path) for path in results], output)
    click.echo(f"report: {output}")
