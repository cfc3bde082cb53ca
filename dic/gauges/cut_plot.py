"""A picture of line cuts: displacement or strain along a line in one or several images."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from dic.errors import is_whole, require_kind
from dic.gauges.plot import NAMES, cameras_of, chosen_kinds, refused, require_one_unit
from dic.gauges.reading import Profile
from dic.gauges.series import GaugeImage, GaugeSeries
from dic.pictures.contact_sheet import evenly_spaced, shortened
from dic.pictures.plots import (
    BAND_TEXT,
    DASHES,
    draw_banded,
    legend_below,
    new_plot,
    plot_style,
    strain_unit,
    write_plot,
)
from dic.pictures.settings import PlotSettings
from dic.typing import PathLike

QUANTITIES = {name: NAMES[name] for name in ("u", "v", "exx", "eyy", "exy")}
"""The quantities that can be drawn along a cut, and their names on the axis."""
_LENGTHS = ("u", "v")
MOST_IMAGES = 8
"""Largest number of images that are drawn if the user does not choose images."""
_COLOUR_MAP, _LIGHTEST = "viridis", 0.88


@dataclass(frozen=True)
class _Curve:
    """The values of one image along one cut."""

    number: int
    label: str
    kind: str
    profile: Profile


@dataclass(frozen=True)
class _Panel:
    """All curves of one cut and one camera."""

    title: str
    curves: list[_Curve]


def plot_cuts(
    series: GaugeSeries,
    path: PathLike,
    *,
    quantity: str = "eyy",
    images: Sequence[int] = (),
    kinds: Sequence[str] = (),
    settings: PlotSettings | None = None,
) -> list[str]:
    """Write a picture of the line cuts, one panel for each cut, with 95 % intervals as bands.

    A place without a value leaves a gap in the line. Images have colours from dark to light, in their order.

    Parameters
    ----------
    series : GaugeSeries
        From `measure_gauges`, with at least one line cut.
    path : path
        The ending gives the format: .png, .pdf or .svg.
    quantity : str
        "u", "v", "exx", "eyy" or "exy".
    images : sequence of int, optional
        Numbers of the images to draw, from 1. Default: all images, or of a longer series 8 measured images at
        equal distances.
    kinds : sequence of str, optional
        Some of "corrected", "calibrated" and "raw". Default: the best kind that any image has.
    settings : PlotSettings, optional

    Returns
    -------
    list of str
        One sentence for each image that has no values along a cut.

    Raises
    ------
    GaugeError
        If there is nothing to draw, or an argument is unknown.
    OSError
        If the picture cannot be written.
    """
    require_kind("series", series, GaugeSeries, "read gauges first: dic.measure_gauges(results, gauges)")
    settings = settings or PlotSettings()
    if quantity not in QUANTITIES:
        expected = f"one of {', '.join(QUANTITIES)}"
        raise refused(series, "choose quantity", expected, repr(quantity), "give eyy")
    left_out: list[str] = []
    panels = list(_panels(series, quantity, images, chosen_kinds(series, kinds), left_out))
    if not any(panel.curves for panel in panels):
        remedy = "look at the reasons in the table of `dic gauges -o`"
        raise refused(series, f"draw {quantity}", "a cut with values", "none", remedy)
    for panel in panels if quantity in _LENGTHS else ():
        require_one_unit(series, quantity, (curve.profile.unit for curve in panel.curves))
    with plot_style():
        figure, axes = new_plot(settings, len(panels))
        for axis, panel in zip(axes, panels, strict=True):
            _draw(axis, panel, quantity)
        known = [curve.profile.values[f"{quantity}_std"] for panel in panels for curve in panel.curves]
        banded = any(np.isfinite(std).any() for std in known)
        legend_below(figure, f"{BAND_TEXT if banded else 'no standard deviations'}; gap: no value")
        write_plot(figure, path, settings)
    return left_out


def _panels(
    series: GaugeSeries, quantity: str, images: Sequence[int], kinds: tuple[str, ...], left_out: list[str]
) -> Iterator[_Panel]:
    cuts = [gauge for gauge in series.gauges if gauge.is_profile]
    if not cuts:
        kinds_given = ", ".join(sorted({gauge.kind for gauge in series.gauges}))
        remedy = 'declare a cut, such as --declare "middle=cut start=100,200 end=300,200"'
        raise refused(series, "draw cuts", "a line cut", f"gauges: {kinds_given}", remedy)
    for gauge in cuts:
        for camera, own in cameras_of(series).items():
            title = f"{gauge.name}, {camera}" if camera else gauge.name
            numbers = _numbers(series, images, own)
            curves = [
                _Curve(number, _label(number, own[number - 1]), kind, profile)
                for number in numbers
                for kind in kinds
                if (profile := _profile(own[number - 1], gauge.name, kind, quantity)) is not None
            ]
            drawn = {curve.number for curve in curves}
            missing = [own[number - 1] for number in numbers if number not in drawn]
            left_out += [f"{title}: no values in {PurePath(image.label).name}" for image in missing]
            yield _Panel(title, curves)


def _numbers(series: GaugeSeries, given: Sequence[int], images: Sequence[GaugeImage]) -> list[int]:
    """Return the numbers of the images to draw, from 1."""
    count = len(images)
    for number in given:
        if not is_whole(number) or not 1 <= number <= count:
            expected, remedy = f"numbers from 1 to {count}", f"give for example {count}"
            raise refused(series, "choose images", expected, str(number), remedy)
    if given:
        return sorted(set(given))
    if count <= MOST_IMAGES:
        return list(range(1, count + 1))
    measured = [number for number, image in enumerate(images, 1) if image.failure is None]
    return [measured[k] for k in evenly_spaced(len(measured), MOST_IMAGES)]


def _profile(image: GaugeImage, gauge: str, kind: str, quantity: str) -> Profile | None:
    """Return the values of a line cut in an image; None if no place of the cut has a value."""
    found = image.readings.get(gauge, {}).get(kind)
    return found if isinstance(found, Profile) and np.isfinite(found.values[quantity]).any() else None


def _label(number: int, image: GaugeImage) -> str:
    return f"{number}: {shortened(str(image.known.get('step', image.label)))}"


def _draw(axis: Any, panel: _Panel, quantity: str) -> None:
    from matplotlib import colormaps

    axis.set_title(panel.title)
    if not panel.curves:
        axis.text(0.5, 0.5, "no values", transform=axis.transAxes, ha="center")
        return
    profiles = [curve.profile for curve in panel.curves]
    unit, scale = profiles[0].unit, 1.0
    if quantity not in _LENGTHS:
        unit, scale = strain_unit(np.concatenate([profile.values[quantity] for profile in profiles]))
    numbers = sorted({curve.number for curve in panel.curves})
    shades = np.linspace(0.0, _LIGHTEST, max(len(numbers), 2))
    several = len({curve.kind for curve in panel.curves}) > 1
    for curve in panel.curves:
        style = {
            "color": colormaps[_COLOUR_MAP](shades[numbers.index(curve.number)]),
            "linestyle": DASHES[curve.kind] if several else "-",
        }
        values, std = (curve.profile.values[name] * scale for name in (quantity, f"{quantity}_std"))
        label = f"{curve.label}, {curve.kind}" if several else curve.label
        draw_banded(axis, curve.profile.distance, values, std, label, style)
    kinds = "" if several else f" {panel.curves[0].kind}"
    axis.set(xlabel=f"distance along the cut, {profiles[0].distance_unit}")
    axis.set(ylabel=f"{QUANTITIES[quantity]}{kinds}, {unit}")
