"""The paper's numerical assessment: how well a bicubic map undoes perspective and distortion, without noise.

Grid points are projected by a pinhole camera, the bicubic map is fitted to them, and other points of the
plane are projected, mapped back to the grid and projected again. The distance on the sensor is the error
(Helm and Deaner, *Off-Axis Two-Dimensional Digital Image Correlation*, "Calibration assessment").
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.calibration.bicubic import BicubicMap
from dic.calibration.pinhole.camera import Pinhole

Float = NDArray[np.float64]

CLAIM_PX = 0.02
"""The paper's claim: base and fine grid stay below this at every angle up to 30°."""

_HALF_MM = 5.0
_OVERSIZE = 1.4


@dataclass(frozen=True)
class PointSet:
    """Points on which the error is judged: `count` × `count` over ± `half_mm`."""

    name: str
    half_mm: float
    count: int

    def points_mm(self) -> Float:
        """Return the points, shape (count², 2), row by row."""
        line = np.linspace(-self.half_mm, self.half_mm, self.count)
        return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


BASE = PointSet("base", _HALF_MM, 21)
"""The points the map is fitted to."""
FINE = PointSet("fine", _HALF_MM, 101)
"""The same area, points between the grid's lines included."""
OVERSIZED = PointSet("oversized", _HALF_MM * _OVERSIZE, 141)
"""An area 40 % larger than the grid."""
POINT_SETS = (BASE, FINE, OVERSIZED)


@dataclass(frozen=True)
class ErrorStatistics:
    """Back-projected error over a point set, px."""

    mean_px: float
    maximum_px: float
    std_px: float


@dataclass(frozen=True)
class Sweep:
    """One series of cameras.

    Attributes
    ----------
    name : str
        For files and tables.
    title, axis : str
        For people: what is varied, and the axis label.
    values : tuple of float
        Degrees, or the distortion's k1 in 1/px².
    camera : callable
        Returns the camera for a value.
    first_figure : int
        The paper's figure for the base grid.
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


def back_projected_error(camera: Pinhole, points: PointSet) -> NDArray[np.float64]:
    """Return the error (count, count) in px on the sensor, rows from the bottom of the grid upwards."""
    grid_mm = BASE.points_mm()
    bicubic = BicubicMap.fit(camera.project(grid_mm), grid_mm)
    image_px = camera.project(points.points_mm())
    again_px = camera.project(bicubic.map(image_px))
    error: NDArray[np.float64] = np.linalg.norm(again_px - image_px, axis=1)
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
    """Return the whole assessment: every sweep, value and point set."""
    return [
        Row(sweep, value, points, statistics(sweep.camera(value), points))
        for sweep in SWEEPS
        for value in sweep.values
        for points in POINT_SETS
    ]


def claim_limit(sweep: Sweep) -> float | None:
    """Return the value of the sweep from which on the base grid's maximum exceeds the paper's 0.02 px.

    None if it does not within the sweep.
    """
    from scipy.optimize import brentq

    def excess(value: float) -> float:
        return statistics(sweep.camera(value), BASE).maximum_px - CLAIM_PX

    for below, above in zip(sweep.values, sweep.values[1:], strict=False):
        if excess(above) > 0 >= excess(below):
            return float(brentq(excess, below, above, rtol=1e-6))
    return None
