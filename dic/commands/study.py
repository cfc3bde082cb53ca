"""The command `dic study`, which compares settings on the user's own images and recommends some."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dic.commands.correlation_options import smoothing_option, smoothing_px
from dic.commands.option_groups import all_of, option_group
from dic.commands.series_options import RegionOptions, region_options
from dic.commands.settings import settings_text
from dic.commands.settings_file import settings_option, used_settings_file
from dic.commands.study_text import table
from dic.errors import each_warning_once
from dic.files.writing import write_text
from dic.shell.output_paths import FORCE, require_places

if TYPE_CHECKING:
    from dic import CorrelationSettings, StrainSettings, StudiedSettings, Study, Sweep, Wave

_FILE = click.Path(path_type=Path)


@dataclass(frozen=True)
class AssumedOptions:
    """Options of the assumed strain; an option that is not given is None."""

    period_px: float | None
    across_period_px: float | None
    strain_amplitude: float | None

    def wave(self) -> "Wave | None":
        """Return the assumed strain; None without these options."""
        from dic import Wave

        values = {
            "period_px": self.period_px,
            "strain_amplitude": self.strain_amplitude,
            "across_px": self.across_period_px,
        }
        given = {name: value for name, value in values.items() if value is not None}
        return Wave(**given) if given else None


@dataclass(frozen=True)
class SweepOptions:
    """Options that list the values of settings; the study tries all combinations of these values."""

    subsets: str
    steps: str
    windows: str
    shapes: str
    parts: int

    def sweep(self) -> "Sweep":
        """Return the combinations to try; raise an error that names all wrong lists together."""
        from dic import Sweep

        subsets, steps, windows = all_of(
            lambda: _numbers("--subsets", self.subsets),
            lambda: _numbers("--steps", self.steps),
            lambda: _numbers("--windows", self.windows),
        )
        shapes = tuple(name.strip() for name in self.shapes.split(","))
        return Sweep(subsets, steps, windows, shapes, self.parts)


@dataclass(frozen=True)
class SharedOptions:
    """Options for the settings that are the same in all combinations."""

    spline: int
    min_zncc: float
    smoothing: str
    strain_measure: str

    def settings(self) -> "CorrelationSettings":
        """Return the options as `CorrelationSettings`."""
        from dic import CorrelationSettings

        return CorrelationSettings(
            order=self.spline, min_zncc=self.min_zncc, smoothing_px=smoothing_px(self.smoothing)
        )

    def strain(self) -> "StrainSettings":
        """Return the options as `StrainSettings`."""
        from dic import StrainSettings

        return StrainSettings(measure=self.strain_measure)


@dataclass(frozen=True)
class OutputOptions:
    """Options that name the output files of `dic study`."""

    json_file: Path | None
    picture: Path | None
    write: Path | None
    force: bool


def _numbers(option: str, text: str) -> tuple[int, ...]:
    from dic import CorrelationError

    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        expected, remedy = "whole numbers with commas between them", f"give for example {option} 3,5,7"
        raise CorrelationError("settings", option, expected, repr(text), remedy) from error


@click.command()
@click.argument("reference", type=_FILE)
@click.argument("images", metavar="[IMAGE]...", type=_FILE, nargs=-1)
@click.option("--static", type=_FILE, help="Image of the specimen at rest; default: recognised among IMAGE.")
@settings_option
@option_group(
    "assumed",
    AssumedOptions,
    click.option(
        "--period-px",
        type=float,
        help="Period of the assumed strain: about twice the width of its smallest detail, px."
        " Default: from a deformed IMAGE, otherwise 100.",
    ),
    click.option(
        "--across-period-px",
        type=float,
        help="Period across the direction of each normal strain, px. Default: from a deformed IMAGE,"
        " otherwise no variation across.",
    ),
    click.option(
        "--strain-amplitude",
        type=float,
        help="Amplitude of the assumed strain. Default: from a deformed IMAGE, otherwise 0.005.",
    ),
)
@option_group(
    "lists",
    SweepOptions,
    click.option("--subsets", default="15,21,31,41,51,61,81", show_default=True, help="Subsets to try, px."),
    click.option("--steps", default="5,10,15", show_default=True, help="Steps to try, px."),
    click.option("--windows", default="3,5,7,9", show_default=True, help="Strain windows to try, points."),
    click.option("--shapes", default="affine,quadratic", show_default=True, help="Shape functions to try."),
    click.option(
        "--parts", default=4, show_default=True, help="Parts of a large region to try the settings on."
    ),
)
@option_group(
    "shared",
    SharedOptions,
    click.option(
        "--spline", default=5, show_default=True, help="Degree of the interpolating spline, 3 or 5."
    ),
    click.option(
        "--min-zncc", default=0.8, show_default=True, help="Smallest correlation (ZNCC) of a good point."
    ),
    smoothing_option,
    click.option(
        "--strain",
        "strain_measure",
        default="green-lagrange",
        show_default=True,
        help="Strain measure: green-lagrange, small or hencky.",
    ),
)
@region_options
@option_group(
    "outputs",
    OutputOptions,
    click.option("--json", "json_file", type=_FILE, help="JSON file of all combinations."),
    click.option("--picture", type=_FILE, help="PNG file: noise and error against resolution."),
    click.option("--write", type=_FILE, help="Settings file (TOML) of the recommended settings."),
    FORCE,
)
@each_warning_once()
def study(
    reference: Path,
    images: tuple[Path, ...],
    static: Path | None,
    assumed: AssumedOptions,
    lists: SweepOptions,
    shared: SharedOptions,
    region: RegionOptions,
    outputs: OutputOptions,
) -> None:
    """Predict the error of strain for many settings on the REFERENCE image, and recommend settings.

    The prediction has two parts. The noise comes from an IMAGE of the specimen at rest, or from the noise of
    the REFERENCE. The systematic error comes from the REFERENCE without its noise, which is deformed by an
    assumed wave of strain. If an IMAGE shows the deformed specimen, the wave is estimated from it.

    A large region is tried in four parts of 448 × 448 px.

    Exit status: 0 for a recommendation, 2 if the images or settings cannot be used.
    """
    from dic import plot_study, read_image, study_settings, write_region
    from dic.shell.console import say
    from dic.shell.progress import progress

    wave, sweep, settings, strain = all_of(assumed.wave, lists.sweep, shared.settings, shared.strain)
    files = [reference, *images, static, *region.files(), used_settings_file()]
    written = [outputs.json_file, outputs.picture, outputs.write, *region.outputs()]
    require_places(files, written, force=outputs.force)
    grey = read_image(reference)
    with progress("trying", sweep.trials) as bar:
        found = study_settings(
            reference,
            images,
            static=static,
            region=region.read((grey.shape[0], grey.shape[1])),
            wave=wave,
            sweep=sweep,
            settings=settings,
            strain=strain,
            advance=bar.advance,
        )
    if region.write_mask is not None:
        write_region(found.region, reference, region.write_mask)
    say(table(found, str(reference)))
    _write(found, reference, outputs)
    if outputs.picture is not None:
        plot_study(found, outputs.picture)


def _write(found: "Study", reference: Path, outputs: OutputOptions) -> None:
    from dic.shell.console import say

    if outputs.json_file is not None:
        content = {"reference": str(reference), **found.as_dict()}
        write_text(outputs.json_file, json.dumps(content, indent=1, ensure_ascii=False))
    if outputs.write is not None:
        write_text(outputs.write, settings_text(_values(found.recommended)) + "\n")
        say(f"settings written to {outputs.write}")


def _values(best: "StudiedSettings") -> dict[str, object]:
    """Return the recommended settings, keyed by "table.key" of a settings file."""
    correlation, strain = best.correlation, best.strain
    return {
        "correlation.subset_px": correlation.subset_px,
        "correlation.step_px": correlation.step_px,
        "correlation.shape": correlation.shape,
        "correlation.order": correlation.order,
        "correlation.min_zncc": correlation.min_zncc,
        "correlation.smoothing_px": correlation.smoothing_px,
        "strain.measure": strain.measure,
        "strain.window_points": strain.window_points,
        "strain.source": strain.source,
    }
