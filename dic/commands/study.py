"""The command `dic study`, which compares settings on the user's own images and recommends some."""

from __future__ import annotations

import json
from pathlib import Path

import click

import dic
from dic import CorrelationSettings, StrainSettings
from dic.commands.options import Chosen, all_of, option, options, use
from dic.commands.series_options import RegionOptions, region_options
from dic.commands.settings import settings_text
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.shared_options import force
from dic.commands.study_text import table
from dic.errors import CorrelationError, each_warning_once
from dic.files import write_text
from dic.shell.console import say
from dic.shell.output_paths import PATH, require_places
from dic.shell.progress import progress


@options
class AssumedOptions:
    """Options of the assumed strain; an option that is not given is None."""

    period_px: float | None = option(
        "--period-px",
        help="Period of the assumed strain: about twice the width of its smallest detail, px."
        " Default: from a deformed IMAGE, otherwise 100.",
    )
    across_period_px: float | None = option(
        "--across-period-px",
        help="Period across the direction of each normal strain, px. Default: from a deformed IMAGE,"
        " otherwise no variation across.",
    )
    strain_amplitude: float | None = option(
        "--strain-amplitude",
        help="Amplitude of the assumed strain. Default: from a deformed IMAGE, otherwise 0.005.",
    )

    def wave(self) -> dic.study.Wave | None:
        """Return the assumed strain; None without these options."""
        values = {
            "period_px": self.period_px,
            "strain_amplitude": self.strain_amplitude,
            "across_px": self.across_period_px,
        }
        given = {name: value for name, value in values.items() if value is not None}
        return dic.study.Wave(**given) if given else None


@options
class SweepOptions:
    """Options that list the values of settings; the study tries all combinations of these values."""

    subsets: str = option("--subsets", default="15,23,31,39,41,47,63,79", help="Subsets to try, px.")
    steps: str = option("--steps", default="5,10,15", help="Steps to try, px.")
    windows: str = option("--windows", default="3,5,7,9", help="Strain windows to try, points.")
    shapes: str = option("--shapes", default="affine,quadratic", help="Shape functions to try.")
    parts: int = option("--parts", default=4, help="Parts of a large region to try the settings on.")

    def sweep(self) -> dic.study.Sweep:
        """Return the combinations to try; raise an error that names all wrong lists together."""
        subsets, steps, windows = all_of(
            lambda: _numbers("--subsets", self.subsets),
            lambda: _numbers("--steps", self.steps),
            lambda: _numbers("--windows", self.windows),
        )
        shapes = tuple(name.strip() for name in self.shapes.split(","))
        return dic.study.Sweep(subsets, steps, windows, shapes, self.parts)


_SHARED = ("order", "min_zncc", "smoothing_px")
"""The settings of the correlation that are the same in all combinations."""


@options
class StudyOutputOptions:
    """Options that name the output files of `dic study`."""

    json_file: Path | None = option("--json", help="JSON file of all combinations.")
    picture: Path | None = option("--picture", help="PNG file: noise and error against resolution.")
    write: Path | None = option("--write", help="Settings file (TOML) of the recommended settings.")
    force: bool = force()


def _numbers(option: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        expected, remedy = "whole numbers with commas between them", f"give for example {option} 3,5,7"
        raise CorrelationError("settings", option, expected, repr(text), remedy) from error


@click.command()
@click.argument("reference", type=PATH)
@click.argument("images", metavar="[IMAGE]...", type=PATH, nargs=-1)
@click.option("--static", type=PATH, help="Image of the specimen at rest; default: recognised among IMAGE.")
@settings_option
@use("assumed", AssumedOptions)
@use("lists", SweepOptions)
@use("shared", CorrelationSettings, title="In all combinations", only=_SHARED)
@use("strain", StrainSettings, title="In all combinations", only=("measure",))
@region_options
@use("outputs", StudyOutputOptions)
@each_warning_once()
def study(
    reference: Path,
    images: tuple[Path, ...],
    static: Path | None,
    assumed: AssumedOptions,
    lists: SweepOptions,
    shared: Chosen[CorrelationSettings],
    strain: Chosen[StrainSettings],
    region: RegionOptions,
    outputs: StudyOutputOptions,
) -> None:
    """Predict the error of strain for many settings on the REFERENCE image, and recommend settings.

    The prediction has two parts. The noise comes from an IMAGE of the specimen at rest, or from the noise of
    the REFERENCE. The systematic error comes from the REFERENCE without its noise, which is deformed by an
    assumed wave of strain. If an IMAGE shows the deformed specimen, the wave is estimated from it.

    A large region is tried in four parts of 448 × 448 px.

    Exit status: 0 for a recommendation, 2 if the images or settings cannot be used.
    """
    wave, sweep, settings, how = all_of(assumed.wave, lists.sweep, shared.settings, strain.settings)
    files = [reference, *images, static, *region.files(), used_settings_file()]
    written = [outputs.json_file, outputs.picture, outputs.write, *region.outputs()]
    require_places(files, written, force=outputs.force)
    grey = dic.read_image(reference)
    with progress("trying", sweep.trials) as bar:
        found = dic.study_settings(
            reference,
            images,
            static=static,
            region=region.read((grey.shape[0], grey.shape[1])),
            wave=wave,
            sweep=sweep,
            settings=settings,
            strain=how,
            advance=bar.advance,
        )
    if region.write_mask is not None:
        dic.specimen.write_region(found.region, reference, region.write_mask)
    say(table(found, str(reference)))
    _write(found, reference, outputs)
    if outputs.picture is not None:
        dic.study.plot_study(found, outputs.picture)


def _write(found: dic.study.Study, reference: Path, outputs: StudyOutputOptions) -> None:
    if outputs.json_file is not None:
        content = {"reference": str(reference), **found.as_dict()}
        write_text(outputs.json_file, json.dumps(content, indent=1, ensure_ascii=False))
    if outputs.write is not None:
        write_text(outputs.write, settings_text(_values(found.recommended)) + "\n")
        say(f"settings written to {outputs.write}")


def _values(best: dic.study.StudiedSettings) -> dict[str, object]:
    """Return the recommended settings, keyed by "table.key" of a settings file."""
    tables = {"correlation": best.correlation, "strain": best.strain}
    return {f"{table}.{name}": value for table, own in tables.items() for name, value in vars(own).items()}
