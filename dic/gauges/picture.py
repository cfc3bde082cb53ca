"""Draws the gauges and their measured points on the reference image, so that a person can check them."""

from typing import Any

import numpy as np

from dic.gauges.placed import PlacedGauges
from dic.pictures.places import mapped
from dic.strain.measurement import Measurement
from dic.typing import Float, Grey

_COLOURS = ("#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7")
"""Colours of gauges, chosen by Okabe and Ito so that colour-blind people can distinguish them."""
_WIDTH_IN = 9.0
_MOST_POINTS = 4000
_FEW_LINES = 5
"""If a gauge has more lines than this number, its lines are drawn thin."""
_GREY_PERCENTILES = (1.0, 99.5)


def draw_gauges(placed: PlacedGauges, measurement: Measurement, reference: Grey) -> Any:
    """Return a matplotlib figure of the reference image with the gauges, their names and their points.

    `measurement`: the measurement of any image of the series.
    """
    from matplotlib.figure import Figure

    height, width = reference.shape
    figure = Figure(figsize=(_WIDTH_IN, min(2.0, height / width) * _WIDTH_IN + 0.6), layout="constrained")
    axes = figure.subplots()
    low, high = np.percentile(reference, _GREY_PERCENTILES)
    axes.imshow(reference, cmap="gray", vmin=low, vmax=max(high, low + 1e-6))
    homography = _to_px(measurement) if any(gauge.unit == "mm" for gauge in placed.gauges) else np.eye(3)
    shown = zip(placed.gauges, placed.points_of(measurement), strict=True)
    for number, (gauge, points) in enumerate(shown):
        lines = [_in_px(line, gauge.unit, homography) for line in gauge.drawn_lines()]
        kept = points[:: 1 + len(points) // _MOST_POINTS]
        _draw(axes, f"{gauge.name} ({gauge.kind})", lines, kept, _COLOURS[number % len(_COLOURS)])
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x, px", ylabel="y, px")
    axes.set_title("gauges and their points in the reference image", fontsize=11)
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    return figure


def _draw(axes: Any, name: str, lines: list[Float], points: Float, colour: str) -> None:
    """Draw the lines and points of one gauge, and add the gauge's name to the legend."""
    from matplotlib import patheffects

    edge = [patheffects.withStroke(linewidth=3.0, foreground="black")]
    thin = len(lines) > _FEW_LINES
    axes.plot(*points.T, "o", color=colour, markersize=3.0, markeredgecolor="black", markeredgewidth=0.4)
    for line in lines:
        width, effects = (0.7, None) if thin else (1.8, edge)
        marker = "+" if len(line) == 1 else None
        axes.plot(*line.T, color=colour, linewidth=width, path_effects=effects, marker=marker, markersize=12)
    # Write the names in the legend: names beside the gauges would overlap, because gauges often overlap.
    axes.plot([], [], color=colour, linewidth=4.0, label=name)


def _in_px(line: Float, unit: str, homography: Float) -> Float:
    return line * (1.0, -1.0) if unit == "px" else mapped(homography, line)


def _to_px(measurement: Measurement) -> Float:
    """Return the homography from millimetres to image pixels that fits the measured points."""
    import cv2

    if measurement.calibrated is None:
        raise ValueError("places in millimetres need calibrated displacements")
    use = measurement.field.active
    points = measurement.field.points.reshape(*use.shape, 2)[use]
    found, _ = cv2.findHomography(measurement.calibrated.position[use], points)
    return np.asarray(found, np.float64)
