"""Cameras that were calibrated with the same grid share what their images show of it."""

from dataclasses import replace

import numpy as np

from dic.calibration.bicubic import BicubicMap
from dic.calibration.calibration import Calibration, as_it_is
from dic.calibration.pinhole.camera import Pinhole
from dic.targets.points import GridPoints
from dic.typing import Float


def of_one_grid(calibrations: tuple[Calibration, ...]) -> tuple[Calibration, ...]:
    """Return the calibrations with the deviations of the grid that all their images together show.

    An oblique camera sees a bow of the grid, a camera that looks straight at the grid takes it for lens
    distortion. Calibrations of a grid without deviations, or without a pinhole model, are returned unchanged.
    """
    cameras = [calibration.pinhole for calibration in calibrations]
    known = [camera for camera in cameras if camera is not None and camera.deviation_std.any()]
    if len(known) < len(cameras):
        return calibrations
    free = np.logical_and.reduce([camera.deviation_std > 0 for camera in known])
    expected = np.diag(1 / np.min([camera.deviation_std[free] for camera in known], axis=0) ** 2)
    information, sides = expected, np.zeros(np.count_nonzero(free))
    for camera in known:
        own = np.linalg.inv(camera.deviation_covariance[np.ix_(free, free)])
        information = information + own - np.diag(1 / camera.deviation_std[free] ** 2)
        sides = sides + own @ camera.deviations[free]
    covariance = np.zeros((len(free),) * 2)
    covariance[np.ix_(free, free)] = np.linalg.inv(information)
    deviations = covariance[:, free] @ sides
    return tuple(_with(calibration, deviations, covariance) for calibration in calibrations)


def _with(calibration: Calibration, deviations: Float, covariance: Float) -> Calibration:
    """Return a calibration if its grid has these deviations with this covariance."""
    pinhole = calibration.pinhole
    if pinhole is None:
        raise ValueError("this calibration knows no camera centre")
    moved, grid = pinhole.on_grid(deviations, covariance), calibration.grid
    nominal = GridPoints.on_lattice(grid.index, grid.uv_px, grid.lines, grid.pitch_mm)
    met, shared_mm = as_it_is(replace(grid, xy_mm=nominal.xy_mm), moved)
    bicubic = BicubicMap.fit(met.uv_px, met.xy_mm, shared_mm)
    return replace(calibration, pinhole=moved, grid=met, bicubic=bicubic)


def shared_factors(pinhole: Pinhole) -> int:
    """Return how many of the last columns of `error_factors` belong to errors of the grid."""
    return len(pinhole.deviations) if pinhole.deviation_covariance.any() else 0
