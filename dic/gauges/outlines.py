"""The outlines of gauges: the places that a gauge declares, and the lines that a picture shows."""

import numpy as np

from dic.errors import GaugeError
from dic.gauges.declared import (
    Extensometer,
    Gauge,
    LineCut,
    PointGauge,
    StrainGauge,
    TransverseExtensometer,
)
from dic.typing import Float

_SQUARE = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])


def corners_of(gauge: Gauge) -> Float:
    """Return the places that a gauge declares, shape (n, 2), in its unit, second coordinate upwards."""
    match gauge:
        case StrainGauge():
            return gauge.outline
        case PointGauge():
            return gauge.upwards([gauge.at])
        case TransverseExtensometer():
            start, end, aside = _middle_line(gauge)
            return np.array([start - aside, start + aside, end + aside, end - aside])
        case Extensometer() | LineCut():
            return gauge.upwards([gauge.start, gauge.end])
    raise TypeError(f"{type(gauge).__name__} is no kind of gauge")


def require_inside(gauge: Gauge, image_shape: tuple[int, ...]) -> None:
    """Raise an error if a gauge in px has a place outside the image; a gauge in mm is not checked.

    Parameters
    ----------
    gauge : Gauge
    image_shape : tuple of int
        Height and width of the image, px.

    Raises
    ------
    GaugeError
    """
    if gauge.unit != "px":
        return
    corners = corners_of(gauge) * (1.0, -1.0)
    height, width = image_shape
    outside = ((corners < 0.0) | (corners > (width - 1.0, height - 1.0))).any(axis=1)
    if outside.any():
        x, y = corners[outside][0]
        raise GaugeError(
            f"gauge {gauge.name!r}",
            "find its place",
            f"places inside the image of {width} × {height} px",
            f"({x:.4g}, {y:.4g})",
            "move the gauge into the image; x counts to the right, y downwards",
        )


def outlines_of(gauge: Gauge) -> list[Float]:
    """Return the lines that draw a gauge, each of shape (n, 2), in the same unit and axes as `corners_of`."""
    corners = corners_of(gauge)
    match gauge:
        case StrainGauge():
            return [np.concatenate([corners, corners[:1]])]
        case Extensometer():
            return [corners, *(_patch(at, corners[1] - corners[0], gauge.patch) for at in corners)]
        case TransverseExtensometer():
            start, end, aside = _middle_line(gauge)
            shares = np.linspace(-1.0, 1.0, gauge.lines)
            return [np.array([start + share * aside, end + share * aside]) for share in shares]
        case PointGauge() if gauge.width is not None:
            return [corners[0] + gauge.width * _SQUARE]
    return [corners]


def _middle_line(gauge: TransverseExtensometer) -> tuple[Float, Float, Float]:
    """Return both ends of the gauge's middle line, and the vector from the middle line to the last line."""
    start, end = gauge.upwards(gauge.start), gauge.upwards(gauge.end)
    direction = (end - start) / np.linalg.norm(end - start)
    return start, end, 0.5 * gauge.spread * np.array([-direction[1], direction[0]])


def _patch(centre: Float, along: Float, width: float) -> Float:
    direction = along / np.linalg.norm(along)
    axes = np.array([direction, [-direction[1], direction[0]]])
    return np.asarray(centre + width * _SQUARE @ axes)
