"""The figures of a tensile test in the report: stress against strain of all columns, and of all gauges."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dic.properties.properties import Properties
from dic.report.style import (
    CONFIDENCE,
    MARKERS,
    OFF_AXIS_COLOURS,
    ON_AXIS_COLOUR,
    legend_below,
    new_figure,
)
from dic.report.tensile_record import TensileColumn, TensileTest
from dic.report.thinning import thinned
from dic.typing import Float

_MICRO = 1e6
_WIDEST, _NARROWEST = 4.0, 1.3
"""Width of the first and of the last curve, points. A curve that others cover is wider, so that it remains
visible.
"""
_LINEAR_MICRO = 50.0
"""Differences of strain up to this size have a linear scale, and larger ones a logarithmic scale, µε."""
_DASHES = {"corrected": "-", "calibrated": (0, (2.5, 1)), "raw": (0, (1, 1))}


def curves_figure(test: TensileTest) -> Any:
    """Return a figure of stress against strain of all columns of a test.

    Curves of good cameras nearly coincide. So that all remain visible, the first curve is the widest and the
    last the narrowest, and their markers are at different points. A third chart shows the differences from
    the last column.
    """
    figure, axes = new_figure(3 if len(test.columns) > 1 else 2, 4.4)
    ends = []
    for order, column in enumerate(test.columns):
        record = column.properties.record
        for axis in axes[:2]:
            axis.plot(100.0 * record.strain, record.strained_stress, **_style(test.columns, order))
        ends.append(beginning_of(column.properties))
    reach, top = max(end[0] for end in ends), max(end[1] for end in ends)
    axes[1].set(xlim=(-0.02 * reach, reach), ylim=(0.0, top))
    for axis, title in zip(axes, ("whole curve", "beginning"), strict=False):
        axis.set(title=title, xlabel="engineering strain, %", ylabel="stress, MPa")
    if len(test.columns) > 1:
        _draw_differences(axes[2], test)
    figure.subplots_adjust(top=0.93, right=0.965)
    legend_below(figure, columns=4)
    return figure


def gauges_figure(test: TensileTest) -> Any:
    """Return a figure of stress against the strain of each gauge, with 95 % bands, for the best column."""
    figure, (axis,) = new_figure(1, 3.6)
    series = test.series_of(test.main.camera)
    load_n = np.array([float(image.known.get("load_n", np.nan)) for image in series.images])
    stress = load_n / test.settings.area_mm2
    gauges = [gauge for gauge in series.gauges if not gauge.is_profile]
    for order, gauge in enumerate(gauges):
        strain, std = series.strain(gauge.name, test.main.read.kind)
        colour, marker = OFF_AXIS_COLOURS[order % len(OFF_AXIS_COLOURS)], MARKERS[order % len(MARKERS)]
        axis.plot(
            100.0 * strain, stress, color=colour, marker=marker, markersize=3, label=_gauge_label(test, gauge)
        )
        drawn = thinned(strain, stress, std)
        low, high = (100.0 * (strain + side * CONFIDENCE * std)[drawn] for side in (-1.0, 1.0))
        axis.fill_betweenx(stress[drawn], low, high, color=colour, alpha=0.2, linewidth=0)
    axis.axvline(0.0, color="0.6", linewidth=0.8)
    axis.set(xlabel="engineering strain, %", ylabel="stress, MPa")
    legend_below(figure, columns=4)
    return figure


def _gauge_label(test: TensileTest, gauge: Any) -> str:
    use = {test.gauge: "along", test.transverse: "across"}.get(gauge.name)
    named = f"“{gauge.name}” ({gauge.kind}"
    return f"{named})" if use in (None, gauge.name) else f"{named}, {use} the specimen)"


def _style(columns: Sequence[TensileColumn], order: int) -> dict[str, Any]:
    """Return how the curve of a column is drawn: colour by camera, dashes by kind of strain."""
    column, many = columns[order], len(columns)
    cameras = list(dict.fromkeys(one.camera for one in columns if one.camera != "on_axis"))
    colour = ON_AXIS_COLOUR
    if column.camera != "on_axis":
        colour = OFF_AXIS_COLOURS[cameras.index(column.camera) % len(OFF_AXIS_COLOURS)]
    best = column.read.kind == "corrected" or many == 1
    return {
        "color": colour,
        "linewidth": _WIDEST - (_WIDEST - _NARROWEST) * order / max(many - 1, 1) if many > 1 else _NARROWEST,
        "linestyle": "-" if many == 1 else _DASHES[column.read.kind],
        "alpha": 0.85 if order == many - 1 else 0.55,
        "marker": MARKERS[order % len(MARKERS)],
        "markersize": 4.5,
        "markerfacecolor": colour if best else "white",
        "markevery": (order, many),
        "label": column.label,
    }


def _draw_differences(axis: Any, test: TensileTest) -> None:
    """Draw the difference of each column's strain from the strain of the last column, in the same images."""
    main = test.main
    wanted = dict(zip(main.labels, main.read.curve.strain, strict=True))
    furthest = 0.0
    for order, column in enumerate(test.columns[:-1]):
        record = column.properties.record
        labels = column.labels[: record.end]
        other = np.array([wanted.get(label, np.nan) for label in labels])
        micro: Float = _MICRO * (record.strain - other)
        furthest = max(furthest, float(np.nanmax(np.abs(micro), initial=0.0)))
        axis.plot(micro, record.strained_stress, **_style(test.columns, order) | {"label": None})
    reference = _style(test.columns, len(test.columns) - 1)
    axis.axvline(0.0, color=reference["color"], linewidth=_NARROWEST)
    if furthest > 5.0 * _LINEAR_MICRO:
        axis.set_xscale("symlog", linthresh=_LINEAR_MICRO)
        low, high = axis.get_xlim()
        powers = [sign * 10.0**power for power in range(2, 7) for sign in (-1.0, 1.0)]
        axis.set_xticks([0.0, *(tick for tick in powers if low <= tick <= high)])
        axis.set_xlim(low, high)
    axis.xaxis.set_major_formatter("{x:g}")
    axis.set(title="difference of strain", xlabel="strain minus that of the best, µε")


def beginning_of(properties: Properties) -> tuple[float, float]:
    """Return the strain in % and the stress in MPa up to which the beginning of a curve is drawn."""
    record, elastic = properties.record, properties.elastic
    if elastic is None:
        return 100.0 * float(record.strain.max()), 1.05 * float(record.strained_stress.max())
    last = min(2 * elastic.line.stop, len(record.strain)) - 1
    reach = 150.0 * float(record.strain[elastic.line.stop - 1])
    inside = 100.0 * record.strain[: last + 1] <= reach
    return reach, 1.08 * float(record.strained_stress[: last + 1][inside].max())
