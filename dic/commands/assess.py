"""The command `dic assess`, which repeats the paper's numerical assessment of the calibration."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

import dic
from dic.files import write_text
from dic.shell.console import say
from dic.shell.output_paths import FORCE, PATH, require_places

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
    type=PATH,
    default="assessment",
    show_default=True,
    help="Folder for the figures and the table.",
)
@click.option("--json", "json_file", type=PATH, help="JSON file of the table and the findings.")
@FORCE
def assess(output: Path, json_file: Path | None, force: bool) -> None:
    """Repeat the paper's numerical assessment of the calibration, and write figures 2 to 14 and a table.

    A simulated pinhole camera records an image of an exact grid. This grid and its image have no errors. So
    the remaining error of the bicubic map is the error of the calibration method alone. Helm and Deaner claim
    errors below 0.02 px. The command prints the angles and distortions beyond which this claim does not hold.
    The command also compares the errors of the bicubic map with the errors of the pinhole model.
    """
    output.mkdir(parents=True, exist_ok=True)
    require_places([], [output / "assessment.csv", output / "assessment.json", json_file], force=force)
    assessment = dic.assessment.assess_method()
    dic.assessment.plot_assessment(assessment, output)
    table = assessment.table()
    lines = [",".join(table[0])] + [",".join(_text(value) for value in record.values()) for record in table]
    write_text(output / "assessment.csv", "\n".join(lines) + "\n")
    content = json.dumps(assessment.as_dict(), indent=1, ensure_ascii=False)
    for path in (output / "assessment.json", json_file):
        if path is not None:
            write_text(path, content)
    _print_table(assessment)
    for finding in assessment.findings:
        say(finding)
    _print_models(assessment)
    say(f"figures 2 to 14, overview.png and assessment.csv are in {output}")


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _print_table(assessment: dic.assessment.Assessment) -> None:
    say("error on the sensor, px              mean     maximum   standard deviation")
    for row in assessment.rows:
        if any(abs(row.value - value) <= 1e-6 * abs(value) for value in _SHOWN[row.sweep.name]):
            case = f"{row.sweep.name:<11}{row.value:>8.3g}  {row.points.name:<10}"
            error = row.error
            say(f"{case}  {error.mean_px:>9.2e}   {error.maximum_px:>9.2e}   {error.std_px:>9.2e}")


def _print_models(assessment: dic.assessment.Assessment) -> None:
    exact, noisy = "exact grid points", f"noisy by {assessment.noise_px} px"
    say(f"rms error of both models, px    {exact:<22}{noisy}")
    say(f"{'':<30}" + "  bicubic    pinhole" * 2)
    for row in assessment.models:
        cells = [errors[model] for errors in (row.exact_px, row.noisy_px) for model in ("bicubic", "pinhole")]
        say(f"{row.camera:<30}" + "".join(f"  {cell:>9.2e}" for cell in cells))
