"""The paper's numerical assessment: how well a bicubic map corrects perspective and distortion.

A pinhole camera projects the grid points without noise, and the bicubic map is fitted to their image points.
Then other points of the plane are projected, mapped back to the grid and projected again. The error is the
distance between the two projections on the sensor (Helm and Deaner, *Off-Axis Two-Dimensional Digital Image
Correlation*, "Calibration assessment").
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dic.calibration.bicubic import BicubicMap
from dic.calibration.pinhole.camera import Pinhole
from dic.typing import Float

CLAIM_PX = 0.02
"""The paper's claim: the errors on the base and the fine grid stay below this at all angles up to 30°."""

_HALF_MM = 5.0
_OVERSIZE = 1.4


@dataclass(frozen=True)
class PointSet:
    """Points at which the error is computed: `count` × `count` points over ± `half_mm` in X and Y."""

    name: str
    half_mm: float
    count: int

    def points_mm(self) -> Float:
        """Return the points, shape (count², 2), row by row."""
        line = np.linspace(-self.half_mm, self.half_mm, self.count)
        return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


BASE = PointSet("base", _HALF_MM, 21)
"""The points to which the map is fitted."""
FINE = PointSet("fine", _HALF_MM, 101)
"""The same area, with points between the grid's lines."""
OVERSIZED = PointSet("oversized", _HALF_MM * _OVERSIZE, 141)
"""An area 40 % larger than the grid."""
POINT_SETS = (BASE, FINE, OVERSIZED)


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of the back-projected error over a point set, px."""

    mean_px: float
    maximum_px: float
    std_px: float


@dataclass(frozen=True)
class Sweep:
    """A series of cameras in which one value is varied.

    Attributes
    ----------
    name : str
        For files and tables.
    title, axis : str
        For people: the title, and the label of the axis of the varied value.
    values : tuple of float
        The varied angle in degrees, or the distortion coefficient k1 in 1/px².
    camera : callable
        Takes a value and returns the camera.
    first_figure : int
        Number of the paper's figure for the base grid.
    """

    name: str
    title: str
    axis: str
    values: tuple[float, ...]
    camera: Callable[[float], Pinhole]
    first_figure: int

    def figure(self, points: PointSet) -> int:
        """Return the number of the paper's figure that shows `points`."""
        return self.first_figure + POINT_SETS.index(points)


_ANGLES = tuple(float(angle) for angle in range(31))
_DISTORTIONS = tuple(float(k) for k in 10.0 ** np.linspace(-9, -7, 17))
SWEEPS = (
    Sweep("pan", "pan", "pan angle, °", _ANGLES, lambda a: Pinhole.swung(pan_deg=a), 2),
    Sweep(
        "pan_tilt",
        "pan = tilt",
        "pan angle = tilt angle, °",
        _ANGLES,
        lambda a: Pinhole.swung(pan_deg=a, tilt_deg=a),
        6,
    ),
    Sweep(
        "pincushion",
        "pan 15°, pincushion distortion",
        "distortion coefficient, 1/px²",
        _DISTORTIONS,
        lambda k: Pinhole.swung(pan_deg=15.0, k1_per_px2=k),
        9,
    ),
    Sweep(
        "barrel",
        "pan 15°, barrel distortion",
        "distortion coefficient, 1/px²",
        tuple(-k for k in _DISTORTIONS),
        lambda k: Pinhole.swung(pan_deg=15.0, k1_per_px2=k),
        12,
    ),
)


def back_projected_error(camera: Pinhole, points: PointSet) -> Float:
    """Return the error on the sensor, px, shape (count, count); the first row is the bottom of the grid."""
    grid_mm = BASE.points_mm()
    bicubic = BicubicMap.fit(camera.project(grid_mm), grid_mm)
    image_px = camera.project(points.points_mm())
    again_px = camera.project(bicubic.map(image_px))
    error: Float = np.linalg.norm(again_px - image_px, axis=1)
    return error.reshape(points.count, points.count)


def statistics(camera: Pinhole, points: PointSet) -> ErrorStatistics:
    """Return mean, maximum and standard deviation of `back_projected_error`."""
    error = back_projected_error(camera, points)
    return ErrorStatistics(float(error.mean()), float(error.max()), float(error.std()))


@dataclass(frozen=True)
class Row:
    """One line of the assessment's table."""

    sweep: Sweep
    value: float
    points: PointSet
    error: ErrorStatistics


def assess() -> list[Row]:
    """Return the whole assessment: one row for each sweep, value and point set."""
    return [
        Row(sweep, value, points, statistics(sweep.camera(value), points))
        for sweep in SWEEPS
        for value in sweep.values
        for points in POINT_SETS
    ]


def claim_limit(sweep: Sweep) -> float | None:
    """Return the value of the sweep at which the maximum error on the base grid reaches the paper's 0.02 px.

    None if the error stays below 0.02 px in the whole sweep.
    """
    from scipy.optimize import brentq

    def excess(value: float) -> float:
        return statistics(sweep.camera(value), BASE).maximum_px - CLAIM_PX

    for below, above in zip(sweep.values, sweep.values[1:], strict=False):
        if excess(above) > 0 >= excess(below):
            return float(brentq(excess, below, above, rtol=1e-6))
    return None
