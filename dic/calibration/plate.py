"""Move a calibration from the plane of the grid's lines to a specimen's surface that lies behind this plane.

A grid is often printed on a plate that is laid on the specimen. The lines then lie nearer to the camera than
the specimen's surface, by the thickness of the plate. Let C be the camera's centre. Consider a ray that meets
the grid's plane at m, and a surface at the distance p behind this plane. The ray meets the surface at m + (m
- C) p/Cz.
"""

import math
from dataclasses import replace

import numpy as np

from dic.calibration.bicubic import BicubicMap
from dic.calibration.calibration import Calibration
from dic.errors import CalibrationError, is_number, require_all
from dic.typing import Float

_THICKEST_SHARE = 0.5
"""Largest accepted thickness, as a fraction of the distance between camera and grid."""


def behind(calibration: Calibration, plate_mm: float) -> Calibration:
    """Return the calibration of a surface that lies `plate_mm` behind the grid's lines.

    A negative value means that the surface lies in front of the lines. X, Y and Z of the result have their
    origin on the surface. The grid points of the result are the places where the rays through the grid's
    lines meet the surface.

    Raises `CalibrationError` if the camera's centre is not known, or if `plate_mm` is not a number or is too
    large.
    """
    source, pinhole = calibration.source or "calibration", calibration.pinhole
    if pinhole is None:
        raise CalibrationError(
            source,
            "move to the specimen's surface",
            "a pinhole model, which gives the camera's centre",
            f"none, because {calibration.pinhole_problem}",
            "give --plate-mm 0, or calibrate with more lines in view",
        )
    away_mm = float(pinhole.centre_mm[2])
    check = (
        is_number(plate_mm) and math.isfinite(plate_mm) and abs(plate_mm) <= _THICKEST_SHARE * away_mm,
        "distance of the surface behind the grid's lines",
        f"at most half of the camera's distance, {_THICKEST_SHARE * away_mm:.3g} mm",
        f"{plate_mm} mm",
        "give --plate-mm 1 for a plate of 1 mm, or 0 for none",
    )
    require_all(CalibrationError, source, [check])
    share, foot_mm = plate_mm / away_mm, pinhole.centre_mm[:2]
    grid, bicubic = calibration.grid, calibration.bicubic
    return replace(
        calibration,
        bicubic=_scaled(bicubic, share, foot_mm),
        grid=replace(grid, xy_mm=grid.xy_mm + share * (grid.xy_mm - foot_mm)),
        pinhole=replace(pinhole, centre_mm=pinhole.centre_mm + np.array([0.0, 0.0, plate_mm])),
        plate_mm=calibration.plate_mm + plate_mm,
    )


def _scaled(bicubic: BicubicMap, share: float, foot_mm: Float) -> BicubicMap:
    """Return a map whose results are moved away from `foot_mm` by the fraction `share` of their distance."""
    coefficients = (1.0 + share) * bicubic.coefficients
    coefficients[0, 0] -= share * foot_mm
    return replace(
        bicubic, coefficients=coefficients, coefficient_errors=(1.0 + share) * bicubic.coefficient_errors
    )
