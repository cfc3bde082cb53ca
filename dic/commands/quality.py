"""The command `dic quality`, which checks whether an image is suitable for measurement."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

import dic
from dic import CorrelationSettings
from dic.commands.options import Chosen, all_of, option, options, use
from dic.commands.settings_file import settings_option
from dic.commands.shared_options import write_mask
from dic.errors import CorrelationError, each_warning_once
from dic.files import write_text
from dic.shell.console import fail, say, stopped_early, stopping_between
from dic.shell.output_paths import FORCE, PATH, require_places
from dic.shell.progress import progress

UNSURE = 1.5
"""The bias without aliasing is also printed if it is larger than this multiple of the predicted bias."""


@options
class PlannedOptions:
    """Options that describe the planned experiment, for which the image is judged."""

    wanted_px: float = option("--wanted-px", default=0.01, help="Displacement to be resolved, px.")
    strain_range: float = option(
        "--strain-range",
        default=0.01,
        help="Largest strain of the experiment, for the strain error of interpolation.",
    )
    write_mask: Path | None = write_mask()

    def require(self) -> None:
        """Raise an error that names all wrong options together."""
        all_of(
            lambda: dic.quality.Quality.require_wanted(self.wanted_px),
            lambda: dic.quality.Quality.require_strain_range(self.strain_range),
        )


@click.command()
@click.argument("images", metavar="IMAGE...", type=PATH, nargs=-1, required=True)
@click.option(
    "--roi",
    type=PATH,
    help="Mask image, white in the region to check, or region file. Default: the specimen.",
)
@click.option("--second", type=PATH, help="Second image of the specimen at rest, for a better noise value.")
@settings_option
@use("correlation", CorrelationSettings, only=("subset_px", "shape", "smoothing_px"))
@use("planned", PlannedOptions)
@click.option("--plot", "plot_file", type=PATH, help="PNG file with noise floor, focus and pattern.")
@click.option("--json", "json_file", type=PATH, help="JSON file of the printed results.")
@FORCE
@each_warning_once()
def quality(
    images: tuple[Path, ...],
    roi: Path | None,
    second: Path | None,
    correlation: Chosen[CorrelationSettings],
    planned: PlannedOptions,
    plot_file: Path | None,
    json_file: Path | None,
    force: bool,
) -> None:
    """Check the speckles, light, focus and noise of IMAGE, and print the expected noise of displacements.

    IMAGE may also be several files, a folder, a quoted pattern such as "img*.tif", or a TIFF file of several
    pages: each image is checked, and the JSON has a list `images`.

    Ctrl-C ends the check of several images after the current image and keeps its results.

    Exit status: 0 for good images, 1 if an image has a fault, 2 if an image cannot be checked.
    """
    settings: CorrelationSettings
    settings, _ = all_of(correlation.settings, planned.require)
    write_mask = planned.write_mask
    listed = dic.list_images(*images)
    _require_one(listed, {"--second": second, "--plot": plot_file, "--write-mask": write_mask})
    masks = () if write_mask is None else dic.specimen.region_files(write_mask)
    require_places([*dic.pipeline.files_of(listed), roi, second], [plot_file, json_file, *masks], force=force)
    contents, failures = _check_all(
        listed, lambda image: _check(image, roi, second, planned, settings, plot_file)
    )
    if json_file is not None:
        content = contents[0] if len(listed) == 1 else {"images": contents, "failures": failures}
        write_text(json_file, json.dumps(content, indent=1, ensure_ascii=False))
    good = all(content["good"] for content in contents)
    click.get_current_context().exit(2 if failures else 0 if good else 1)


def _check_all(
    images: Sequence[Path], check: Callable[[Path], dict[str, Any]]
) -> tuple[list[dict[str, Any]], list[dict[str, str]]]:
    """Check images until the last or a signal; return the results and the failures for JSON."""
    contents: list[dict[str, Any]] = []
    failures: list[dict[str, str]] = []
    with progress("checking", len(images)) as bar, stopping_between() as stopped:
        for number, image in enumerate(images, 1):
            try:
                contents.append(check(image))
            except dic.MeasurementError as error:
                if len(images) == 1:
                    raise
                failures.append({"file": str(image), "error": str(error)})
                fail(f"{image}: {error}" if str(image) not in str(error) else str(error))
            bar.advance()
            if stopped() and number < len(images):
                rest = stopped_early(len(images) - number, len(images), "checked")
                failures.append({"file": str(images[number]), "error": rest})
                fail(f"{images[number]}: {rest}; those before it are kept")
                break
    return contents, failures


def _check(
    image: Path,
    roi: Path | None,
    second: Path | None,
    planned: PlannedOptions,
    settings: CorrelationSettings,
    plot_file: Path | None,
) -> dict[str, Any]:
    """Check an image, print the results, and return them for JSON."""
    judged = dic.assess_quality(
        image,
        roi,
        settings,
        second=second,
        wanted_px=planned.wanted_px,
        strain_range=planned.strain_range,
    )
    sentences, figures = dic.quality.quality_findings(judged), judged.as_dict()
    if planned.write_mask is not None:
        dic.specimen.write_region(judged.region, image, planned.write_mask)
    if plot_file is not None:
        dic.quality.plot_quality(judged, image, plot_file)
    say(f"{image}: {'not good' if sentences else 'good'}\n{text(figures)}")
    if judged.specimen is not None and not judged.specimen.is_whole:
        say(f"  {judged.specimen}")
    for sentence in sentences:
        fail(f"{image}: {sentence}")
    specimen = None if judged.specimen is None else judged.specimen.as_dict()
    content = {"image": str(image), **figures, "good": not sentences, "findings": sentences}
    return content | {"specimen": specimen}


def _require_one(images: list[Path], given: dict[str, Path | None]) -> None:
    """Raise an error if there are several images, but an option applies to a single image."""
    for name, value in given.items():
        if value is not None and len(images) > 1:
            raise CorrelationError(
                "settings", name, "one image", f"{len(images)} images", f"leave {name} out"
            )


def text(figures: dict[str, Any]) -> str:
    """Return the values of `Quality.as_dict` as text for the terminal."""

    def number(name: str, digits: int) -> str:
        return "–" if figures[name] is None else f"{figures[name]:.{digits}f}"

    larger = figures["recommended_subset_px"]
    recommended = f"a subset of {larger} px" if larger else "no subset"
    return "\n".join(
        [
            f"  speckles  {number('speckle_x_px', 1)} px along x, {number('speckle_y_px', 1)} px along y",
            *_repetition(figures),
            f"  light     contrast {number('contrast', 2)}; clipped {figures['dark_share']:.2%} dark,"
            f" {figures['bright_share']:.2%} bright; mean gradient {number('mean_gradient', 1)} per px",
            f"  focus     edges blurred by {number('blur_px', 2)} px, worst {number('worst_blur_px', 2)} px",
            f"  noise     {number('noise', 2)} grey levels",
            f"  resolves  u {number('std_u_px', 4)}, v {number('std_v_px', 4)} px (median),"
            f" {number('floor_px', 4)} px at 95 % of the points,"
            f" subset {figures['subset_px']} px, {figures['shape']}",
            f"            sum of squared gradients {number('sssig_x', 0)} in x, {number('sssig_y', 0)} in y",
            *_interpolation(figures),
            f"  advice    {recommended} for {figures['wanted_px']:g} px",
        ]
    )


def _repetition(figures: dict[str, Any]) -> list[str]:
    """Return a line about a pattern that repeats; no line about other patterns."""
    if (found := figures["repetition"]) is None:
        return []
    pairs = zip(found["periods_px"], found["directions_deg"], strict=True)
    periods = " and ".join(f"{period:.1f} px at {direction:.0f}°" for period, direction in pairs)
    how = "irregular enough to be measured" if found["told_apart"] else "one period looks like the next"
    return [f"  repeats   every {periods}; {how}"]


def _interpolation(figures: dict[str, Any]) -> list[str]:
    """Return lines about the interpolation bias and the smoothing; no line if the bias is not known."""
    if figures["bias_u_px"] is None:
        return ["  bias      of interpolation not known: the region is too narrow"]
    lines = [
        f"  bias      of interpolation at most {1e3 * abs(figures['bias_u_px']):.2f} mpx in u,"
        f" {1e3 * abs(figures['bias_v_px']):.2f} mpx in v, {1e6 * figures['bias_strain']:.0f} µε at strains"
        f" up to {100 * figures['strain_range']:g} % (gauge {figures['gauge_px']:.0f} px)"
    ]
    unaliased = max(abs(figures[f"unaliased_bias_{axis}_px"]) for axis in "uv")
    if unaliased > UNSURE * max(abs(figures["bias_u_px"]), abs(figures["bias_v_px"])):
        lines.append(f"            {1e3 * unaliased:.2f} mpx if the camera has not aliased the pattern")
    if figures["smoothing_px"] > 0.0:
        left = f"{1e3 * figures['left_bias_px']:.2f} mpx, {1e6 * figures['left_bias_strain']:.0f} µε"
        lines.append(
            f"            smoothing by {figures['smoothing_px']:g} px before the correlation leaves {left}"
        )
    return lines
