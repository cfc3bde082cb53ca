"""Helm and Deaner's numerical assessment of how well a bicubic map corrects perspective and distortion.

A simulated pinhole camera projects the grid points without noise. The bicubic map is fitted to the projected
points. Then other points of the grid's plane are projected into the image, mapped back to the plane by the
bicubic map, and projected again. The error is the distance on the sensor between the first and the second
projection of a point (Helm and Deaner, *Off-Axis Two-Dimensional Digital Image Correlation*, "Calibration
assessment").
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dic.calibration.bicubic import BicubicMap
from dic.calibration.pinhole.camera import Pinhole
from dic.typing import Float

CLAIM_PX = 0.02
"""The paper claims that errors on base and fine grid stay below this number of px at angles up to 30°."""

_HALF_MM = 5.0
_OVERSIZE = 1.4


@dataclass(frozen=True)
class PointSet:
    """Points for which the error is computed: `count` × `count` points over ± `half_mm` in X and Y."""

    name: str
    half_mm: float
    count: int

    def points_mm(self) -> Float:
        """Return the coordinates X and Y of the points in mm, row by row, shape (count², 2)."""
        line = np.linspace(-self.half_mm, self.half_mm, self.count)
        return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


BASE = PointSet("base", _HALF_MM, 21)
"""The grid points to which the bicubic map is fitted."""
FINE = PointSet("fine", _HALF_MM, 101)
"""Points on the area of the base grid, also between its lines."""
OVERSIZED = PointSet("oversized", _HALF_MM * _OVERSIZE, 141)
"""Points on an area whose sides are 40 % longer than those of the base grid."""
POINT_SETS = (BASE, FINE, OVERSIZED)


@dataclass(frozen=True)
class ErrorStatistics:
    """Mean, maximum and standard deviation, px, of the errors that `back_projected_error` returns."""

    mean_px: float
    maximum_px: float
    std_px: float


@dataclass(frozen=True)
class PaperSweep:
    """A series of simulated cameras in which one angle or distortion coefficient is varied."""

    name: str
    """Name of the sweep in files and tables."""
    title: str
    axis: str
    """The title of plots, and the axis label of the varied value."""
    values: tuple[float, ...]
    """The varied angle in degrees, or the distortion coefficient k1 in 1/px²."""
    camera: Callable[[float], Pinhole]
    """A function that takes the varied value and returns the camera."""
    first_figure: int
    """Number of the figure in Helm and Deaner's paper that shows this sweep on the base grid."""

    def figure(self, points: PointSet) -> int:
        """Return the number of the figure in Helm and Deaner's paper that shows this sweep for `points`."""
        return self.first_figure + POINT_SETS.index(points)


_ANGLES = tuple(float(angle) for angle in range(31))
_DISTORTIONS = tuple(float(k) for k in 10.0 ** np.linspace(-9, -7, 17))
SWEEPS = (
    PaperSweep("pan", "pan", "pan angle, °", _ANGLES, lambda a: Pinhole.swung(pan_deg=a), 2),
    PaperSweep(
        "pan_tilt",
        "pan = tilt",
        "pan angle = tilt angle, °",
        _ANGLES,
        lambda a: Pinhole.swung(pan_deg=a, tilt_deg=a),
        6,
    ),
    PaperSweep(
        "pincushion",
        "pan 15°, pincushion distortion",
        "distortion coefficient, 1/px²",
        _DISTORTIONS,
        lambda k: Pinhole.swung(pan_deg=15.0, k1_per_px2=k),
        9,
    ),
    PaperSweep(
        "barrel",
        "pan 15°, barrel distortion",
        "distortion coefficient, 1/px²",
        tuple(-k for k in _DISTORTIONS),
        lambda k: Pinhole.swung(pan_deg=15.0, k1_per_px2=k),
        12,
    ),
)


def back_projected_error(camera: Pinhole, points: PointSet) -> Float:
    """Return the error in px that the bicubic map of a camera causes at each point, shape (count, count).

    Each point is projected into the image. The bicubic map then maps the image point back to the grid, and
    this grid point is projected again. The error is the distance between the first and the second image
    point. The first row of the result belongs to the bottom of the grid.
    """
    grid_mm = BASE.points_mm()
    bicubic = BicubicMap.fit(camera.project(grid_mm), grid_mm)
    image_px = camera.project(points.points_mm())
    again_px = camera.project(bicubic.map(image_px))
    error: Float = np.linalg.norm(again_px - image_px, axis=1)
    return error.reshape(points.count, points.count)


def statistics(camera: Pinhole, points: PointSet) -> ErrorStatistics:
    """Return the mean, the maximum and the standard deviation of the errors from `back_projected_error`."""
    error = back_projected_error(camera, points)
    return ErrorStatistics(float(error.mean()), float(error.max()), float(error.std()))


@dataclass(frozen=True)
class Row:
    """The statistics of the error for one simulated camera of a sweep and one set of points."""

    sweep: PaperSweep
    value: float
    points: PointSet
    error: ErrorStatistics


def assess() -> list[Row]:
    """Return the error statistics of every simulated camera in `SWEEPS`, for each set in `POINT_SETS`."""
    return [
        Row(sweep, value, points, statistics(sweep.camera(value), points))
        for sweep in SWEEPS
        for value in sweep.values
        for points in POINT_SETS
    ]


def claim_limit(sweep: PaperSweep) -> float | None:
    """Return the angle or distortion coefficient of a sweep at which the largest error reaches 0.02 px.

    Helm and Deaner claim that errors are below 0.02 px. The largest error is taken over the points of the
    base grid. Return None if the error stays below 0.02 px in the whole sweep.
    """
    from scipy.optimize import brentq

    def excess(value: float) -> float:
        return statistics(sweep.camera(value), BASE).maximum_px - CLAIM_PX

    for below, above in zip(sweep.values, sweep.values[1:], strict=False):
        if excess(above) > 0 >= excess(below):
            return float(brentq(excess, below, above, rtol=1e-6))
    return None
