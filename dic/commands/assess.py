"""`dic assess`: the paper's numerical assessment of the calibration."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from dic.assessment.models import ModelRow
    from dic.assessment.paper import Row

_PATH = click.Path(path_type=Path)
_SHOWN = {
    "pan": (0.0, 10.0, 15.0, 20.0, 30.0),
    "pan_tilt": (10.0, 20.0, 30.0),
    "pincushion": (1e-9, 1e-8, 1e-7),
    "barrel": (-1e-9, -1e-8, -1e-7),
}


@click.command()
@click.option(
    "-o",
    "--output",
    type=_PATH,
    default="assessment",
    show_default=True,
    help="Folder for figures and tables.",
)
@click.option("--json", "json_file", type=_PATH, help="The table and the findings, for programs.")
def assess(output: Path, json_file: Path | None) -> None:
    """Repeat the paper's numerical assessment: its figures 2 to 14 as plots, and its numbers as tables.

    A pinhole camera sees a perfect grid; what the bicubic map leaves is the error of the method alone. Where
    the paper's claim of less than 0.02 px does not hold, that is printed. The pinhole model is put beside it.
    """
    from dic.assessment.models import compare_models
    from dic.assessment.paper import assess as compute
    from dic.assessment.plots import plot_assessment
    from dic.shell.output_paths import require_places

    output.mkdir(parents=True, exist_ok=True)
    require_places([], [output / "assessment.csv", output / "assessment.json", json_file])
    rows = compute()
    findings = _findings(rows)
    models = compare_models()
    plot_assessment(output, rows)
    table = [_record(row) for row in rows]
    lines = [",".join(table[0])] + [",".join(_text(value) for value in record.values()) for record in table]
    (output / "assessment.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    compared = [asdict(row) for row in models]
    content = json.dumps(
        {"rows": table, "findings": findings, "models": compared}, indent=1, ensure_ascii=False
    )
    for path in (output / "assessment.json", json_file):
        if path is not None:
            path.write_text(content, encoding="utf-8")
    _print_table(rows)
    for finding in findings:
        click.echo(finding)
    _print_models(models)
    click.echo(f"figures 2 to 14, overview.png and assessment.csv are in {output}")


def _record(row: "Row") -> dict[str, Any]:
    return {
        "sweep": row.sweep.name,
        "value": row.value,
        "grid": row.points.name,
        "figure": row.sweep.figure(row.points),
        "mean_px": row.error.mean_px,
        "maximum_px": row.error.maximum_px,
        "std_px": row.error.std_px,
    }


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _print_table(rows: Sequence["Row"]) -> None:
    click.echo("error on the sensor, px              mean     maximum   standard deviation")
    for row in rows:
        if any(abs(row.value - value) <= 1e-6 * abs(value) for value in _SHOWN[row.sweep.name]):
            case = f"{row.sweep.name:<11}{row.value:>8.3g}  {row.points.name:<10}"
            error = row.error
            click.echo(f"{case}  {error.mean_px:>9.2e}   {error.maximum_px:>9.2e}   {error.std_px:>9.2e}")


def _print_models(rows: Sequence["ModelRow"]) -> None:
    from dic.assessment.models import NOISE_PX

    exact, noisy = "exact grid points", f"noisy by {NOISE_PX} px"
    click.echo(f"rms error of both models, px    {exact:<22}{noisy}")
    click.echo(f"{'':<30}" + "  bicubic    pinhole" * 2)
    for row in rows:
        cells = [errors[model] for errors in (row.exact_px, row.noisy_px) for model in ("bicubic", "pinhole")]
        click.echo(f"{row.camera:<30}" + "".join(f"  {cell:>9.2e}" for cell in cells))


def _findings(rows: Sequence["Row"]) -> list[str]:
    """Return where the paper's claim holds and where it does not, one sentence per sweep."""
    from dic.assessment.paper import BASE, CLAIM_PX, SWEEPS, claim_limit

    sentences = []
    for sweep in SWEEPS:
        last = next(
            row for row in rows if row.sweep is sweep and row.points is BASE and row.value == sweep.values[-1]
        )
        reached = f"{sweep.title}: maximum {last.error.maximum_px:.4f} px at {last.value:g} on the base grid"
        limit = claim_limit(sweep)
        if limit is None:
            sentences.append(f"{reached}; the claim of less than {CLAIM_PX} px holds throughout")
        else:
            sentences.append(
                f"{reached}; the claim of less than {CLAIM_PX} px does not hold beyond {limit:.3g}"
            )
    return sentences
