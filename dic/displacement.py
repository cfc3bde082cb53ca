"""Displacements in one system of axes, raw in pixels or calibrated in millimetres, ready for strain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.calibration import Calibration
from dic.field import Field

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Displacement:
    """Where material points were and how far they went.

    Axes are those of an upright view, x to the right and y up, for pixels too, so that raw and calibrated
    strains compare sign by sign.

    Attributes
    ----------
    position, vector : ndarray, shape (rows, columns, 2)
        Reference position and displacement of every point of the grid; NaN where there is none.
    valid : ndarray of bool, shape (rows, columns)
        Points that may be used for strain.
    unit : str
        "px" or "mm".
    """

    position: Float
    vector: Float
    valid: NDArray[np.bool_]
    unit: str


def raw_displacement(field: Field) -> Displacement:
    """Return a field's displacements in pixels, with y up."""
    shape = (*field.status.shape, 2)
    vector = np.stack([field.u_px, -field.v_px], axis=-1)
    position = (field.points * np.array([1.0, -1.0])).reshape(shape)
    return Displacement(position, vector, field.converged, "px")


def calibrated_displacement(field: Field, calibration: Calibration) -> Displacement:
    """Return a field's displacements in millimetres of the grid.

    Both ends of a displacement are mapped. A point that was, or went, outside the calibrated area keeps its
    value, which is an extrapolation, but is not valid.
    """
    shape = (*field.status.shape, 2)
    before = field.points
    after = before + np.stack([field.u_px, field.v_px], axis=-1).reshape(-1, 2)
    position, moved = calibration.map(before), calibration.map(after)
    inside = calibration.inside(before) & calibration.inside(after)
    return Displacement(
        position.reshape(shape),
        (moved - position).reshape(shape),
        field.converged & inside.reshape(shape[:2]),
        "mm",
    )
