"""A picture of gauges against time, load, a channel or the number of the image, with their uncertainty."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.errors import GaugeError, require_kind
from dic.gauges.channel import MEASURED
from dic.gauges.reading import Reading
from dic.gauges.series import KINDS, GaugeImage, GaugeSeries
from dic.pictures.plots import (
    BAND_TEXT,
    COLOURS,
    DASHES,
    MARKERS,
    draw_banded,
    legend_below,
    new_plot,
    plot_style,
    strain_unit,
    write_plot,
)
from dic.pictures.settings import PlotSettings
from dic.typing import Float, PathLike

AGAINST = {"image": "number of the image", "time": "time, s", "load": "load, {}"}
"""The quantities against which readings can be drawn, and the names of their axes."""
_STRAINS = ("strain", "exx", "eyy", "exy", "e1", "e2")
_LENGTHS = ("extension", "u", "v")
_KEYS = {"time": "time_s", "load": "load_n"}
NAMES = {
    "strain": "engineering strain",
    "exx": "εxx",
    "eyy": "εyy",
    "exy": "εxy",
    "e1": "first principal strain",
    "e2": "second principal strain",
    "extension": "extension",
    "u": "displacement to the right",
    "v": "displacement upwards",
}
LIVE_PREFIX, LIVE = "channels.gauge.", "live"
"""The channels of gauges that were measured while the test ran are called so, and their lines."""
_IN_KN = 1000.0
"""If the largest load is at least this value, in N, loads are drawn in kN."""


@dataclass(frozen=True)
class _Line:
    """One line of the picture: a gauge, a camera and a kind of values."""

    gauge: str
    camera: str
    kind: str
    x: Float
    values: Float
    std: Float
    unit: str


def plot_gauges(
    series: GaugeSeries,
    path: PathLike,
    *,
    against: str = "image",
    quantity: str = "strain",
    kinds: Sequence[str] = (),
    settings: PlotSettings | None = None,
) -> list[str]:
    """Write a picture of the readings of all gauges, except line cuts, with 95 % intervals as bands.

    An image without a reading leaves a gap in the line. Beside strains of gauges, channels of strain are
    drawn.

    Parameters
    ----------
    series : GaugeSeries
        From `measure_gauges`, or from `join_record` for the load of a testing machine.
    path : path
        The ending gives the format: .png, .pdf or .svg.
    against : str
        "image", "time", "load", or a channel of a run such as "channels.oven". Images are numbered from 1 in
        the order of the series of a camera.
    quantity : str
        "strain" (engineering strain along the gauge); "extension" of extensometers; "exx", "eyy", "exy",
        "e1", "e2", "u" or "v" of areas and points.
    kinds : sequence of str, optional
        Some of "corrected", "calibrated" and "raw". Default: the best kind that any image has.
    settings : PlotSettings, optional

    Returns
    -------
    list of str
        One sentence for each gauge and kind that has readings at some images only.

    Raises
    ------
    GaugeError
        If there is nothing to draw, or an argument is unknown.
    OSError
        If the picture cannot be written.
    """
    require_kind("series", series, GaugeSeries, "read gauges first: dic.measure_gauges(results, gauges)")
    settings = settings or PlotSettings()
    lines = _known_lines(series, against, quantity, kinds)
    with plot_style():
        write_plot(_draw(lines, series, against, quantity, settings), path, settings)
    return [sentence for line in lines if (sentence := _gap_sentence(line, against))]


def draw_gauges(series: GaugeSeries, settings: PlotSettings) -> Any:
    """Return the figure of `plot_gauges` with the strain of all gauges; call this within `plot_style`."""
    return _draw(_known_lines(series, "image", "strain", ()), series, "image", "strain", settings)


def refused(series: GaugeSeries, step: str, expected: str, got: str, remedy: str) -> GaugeError:
    """Return the error that names a series whose readings cannot be drawn."""
    return GaugeError(series.source or "gauges", step, expected, got, remedy)


def require_one_unit(series: GaugeSeries, quantity: str, units: Iterable[str]) -> None:
    """Raise an error if the values for one axis have different units."""
    different = sorted(set(units))
    if len(different) > 1:
        remedy = "draw one kind of values"
        raise refused(series, f"draw {quantity}", "values in one unit", " and ".join(different), remedy)


def chosen_kinds(series: GaugeSeries, kinds: Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of strain to draw, from the most accurate to the least accurate.

    Raises `GaugeError` if no image could be measured, or no image has one of the kinds.
    """
    if not series.kinds:
        remedy = "measure at least one image"
        raise refused(series, "draw", "an image that could be measured", "none", remedy)
    for kind in kinds:
        if kind not in series.kinds:
            expected, remedy = f"one of {', '.join(series.kinds)}", f"give {series.kinds[0]}"
            raise refused(series, "choose a kind of values", expected, repr(kind), remedy)
    return tuple(kind for kind in KINDS if kind in kinds) or series.kinds[:1]


def cameras_of(series: GaugeSeries) -> dict[str, list[GaugeImage]]:
    """Return the images of each camera; the camera of a series without cameras is ""."""
    found: dict[str, list[GaugeImage]] = {}
    for image in series.images:
        found.setdefault(str(image.known.get("camera", "")), []).append(image)
    return found


def _known_lines(series: GaugeSeries, against: str, quantity: str, kinds: Sequence[str]) -> list[_Line]:
    lines = list(_lines(series, against, quantity, chosen_kinds(series, kinds)))
    _require_content(series, lines, against, quantity)
    return lines


def _lines(series: GaugeSeries, against: str, quantity: str, kinds: tuple[str, ...]) -> Iterator[_Line]:
    axes = [*AGAINST, *series.channels]
    for what, value, known in (("against", against, axes), ("quantity", quantity, list(NAMES))):
        if value not in known:
            expected, remedy = f"one of {', '.join(known)}", f"give {next(iter(known))}"
            raise refused(series, f"choose {what}", expected, repr(value), remedy)
    for gauge in series.gauges:
        for camera, images in cameras_of(series).items():
            x = _places(series, images, against)
            for kind in kinds:
                readings = [image.readings.get(gauge.name, {}).get(kind) for image in images]
                given = [one for one in readings if isinstance(one, Reading)]
                numbers = [{} if not isinstance(one, Reading) else one.numbers() for one in readings]
                if not any(quantity in each for each in numbers):
                    continue
                values, std = (
                    np.array([each.get(name, np.nan) for each in numbers], np.float64)
                    for name in (quantity, f"{quantity}_std")
                )
                yield _Line(gauge.name, camera, kind, x, values, std, given[0].unit)
    if quantity == "strain":
        yield from _of_channels(series, against)


def _of_channels(series: GaugeSeries, against: str) -> Iterator[_Line]:
    """Yield a line for each channel of strain, at the images of the first camera."""
    images = next(iter(cameras_of(series).values()))
    known, x = [image.known for image in images], _places(series, images, against)
    for name, channel in series.channels.items():
        if channel.is_strain:
            values, std = channel.strain(known), channel.strain_std(known)
            live = name.removeprefix(LIVE_PREFIX)
            shown, kind = (live, LIVE) if live != name else (name, MEASURED)
            yield _Line(shown, "", kind, x, values, std, channel.unit)


def _places(series: GaugeSeries, images: Sequence[GaugeImage], against: str) -> Float:
    if against == "image":
        return np.arange(1.0, len(images) + 1)
    if against in series.channels:
        return series.channels[against].values([image.known for image in images])
    return np.array([float(image.known.get(_KEYS[against], np.nan)) for image in images])


def _require_content(series: GaugeSeries, lines: list[_Line], against: str, quantity: str) -> None:
    if not lines:
        kinds = ", ".join(sorted({gauge.kind for gauge in series.gauges}))
        remedy = "draw line cuts with `dic plot cuts`" if kinds == "cut" else "give strain, or other gauges"
        raise refused(series, f"draw {quantity}", f"a gauge that has {quantity}", f"gauges: {kinds}", remedy)
    if not any(np.isfinite(line.values).any() for line in lines):
        remedy = "look at the reasons in the table of `dic gauges -o`"
        raise refused(series, f"draw {quantity}", "a reading in at least one image", "none", remedy)
    if not any((np.isfinite(line.x) & np.isfinite(line.values)).any() for line in lines):
        remedy = {
            "time": "draw against image, or give the machine's record with --record and --time",
            "load": "give the machine's record with --record and --load",
        }.get(against, "draw against image")
        raise refused(series, f"draw against {against}", f"images with a {against}", "none", remedy)
    if quantity in _LENGTHS:
        require_one_unit(series, quantity, (line.unit for line in lines))


def _draw(
    lines: list[_Line], series: GaugeSeries, against: str, quantity: str, settings: PlotSettings
) -> Any:
    figure, (axis,) = new_plot(settings)
    unit, scale = lines[0].unit, 1.0
    if quantity in _STRAINS:
        unit, scale = strain_unit(np.concatenate([line.values for line in lines]))
    label, divisor = AGAINST.get(against) or _channel_label(series, against), 1.0
    if against == "load":
        loads = np.concatenate([line.x for line in lines])
        divisor = _IN_KN if np.nanmax(np.abs(loads)) >= _IN_KN else 1.0
        label = label.format("kN" if divisor == _IN_KN else "N")
    names = list(dict.fromkeys((line.gauge, line.camera) for line in lines))
    cameras = list(dict.fromkeys(line.camera for line in lines))
    several = len({line.kind for line in lines}) > 1
    for line in lines:
        order = cameras.index(line.camera)
        style = {
            "color": COLOURS[names.index((line.gauge, line.camera)) % len(COLOURS)],
            "marker": MARKERS[order % len(MARKERS)],
            # Two cameras often measure the same, so the markers of one must not hide those of the other.
            "markersize": 3.0 + 2.0 * order,
            "fillstyle": "none" if order else "full",
            "linestyle": DASHES.get(line.kind, "-") if several else "-",
        }
        text = ", ".join(part for part in (line.gauge, line.camera, line.kind) if part)
        draw_banded(axis, line.x / divisor, line.values * scale, line.std * scale, text, style)
    axis.set(xlabel=label, ylabel=f"{NAMES[quantity]}, {unit}")
    if against == "image":
        axis.xaxis.get_major_locator().set_params(integer=True)
    legend_below(figure, _note(lines, series, against))
    return figure


def _channel_label(series: GaugeSeries, against: str) -> str:
    return ", ".join(filter(None, (against, series.channels[against].unit)))


def _note(lines: list[_Line], series: GaugeSeries, against: str) -> str:
    """Return a note for the legend that explains the bands and the gaps in the lines."""
    parts = [BAND_TEXT] if any(np.isfinite(line.std).any() for line in lines) else ["no standard deviations"]
    lacks = ["no reading"] if any(not np.isfinite(line.values).all() for line in lines) else []
    lacks += [f"no {against}"] if any(not np.isfinite(line.x).all() for line in lines) else []
    parts += [f"gap: {' or '.join(lacks)}"] if lacks else []
    if against == "time" and any(image.known.get("time_source") == "file" for image in series.images):
        parts.append("time: last change of the image files")
    return "; ".join(parts)


def _gap_sentence(line: _Line, against: str) -> str:
    missing = int(np.count_nonzero(~np.isfinite(line.values)))
    without = int(np.count_nonzero(np.isfinite(line.values) & ~np.isfinite(line.x)))
    count = len(line.values)
    parts = [f"no reading in {missing} of {count} images"] if missing else []
    parts += [f"no {against} for {without} of {count} images"] if without else []
    name = ", ".join(part for part in (line.gauge, line.camera, line.kind) if part)
    return f"{name}: {', '.join(parts)}" if parts else ""
