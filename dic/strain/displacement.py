"""Displacements in one system of axes, raw in pixels or calibrated in millimetres, ready for strain.

With them goes what the images' noise does to them, to first order. Errors of two points are correlated where
their subsets overlap, because both come from the same pixels.
"""

from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.typing import Float, Mask

_UPWARDS = np.diag([1.0, -1.0])


@dataclass(frozen=True)
class Noise:
    """The errors of displacements that the images' noise causes.

    Attributes
    ----------
    spread : ndarray, shape (rows, columns, 2, 2)
        Takes two independent errors of unit variance, along the image's x and y, to that of the displacement.
    overlap : ndarray, shape (m, n)
        Correlation of the errors at points so many rows and columns of the grid apart; beyond it is 0.
    gradient : ndarray, shape (rows, columns, 4, 4)
        Covariance of the shape function's gradient, its elements in the order xx, xy, yx, yy.
    """

    spread: Float
    overlap: Float
    gradient: Float


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
    gradient : ndarray, shape (rows, columns, 2, 2), or None
        Displacement gradient ∂u_i/∂x_j within each point's subset, from the shape function.
    noise : Noise or None
        Errors, where they are known.
    """

    position: Float
    vector: Float
    valid: Mask
    unit: str
    gradient: Float | None = None
    noise: Noise | None = None

    def __repr__(self) -> str:
        return f"Displacement({int(self.valid.sum())} of {self.valid.size} points valid, {self.unit})"


def raw_displacement(field: Field) -> Displacement:
    """Return a field's displacements in pixels, with y up."""
    shape = (*field.status.shape, 2)
    vector = np.stack([field.u_px, -field.v_px], axis=-1)
    position = (field.points * np.array([1.0, -1.0])).reshape(shape)
    everywhere = np.broadcast_to(_UPWARDS, (*shape, 2))
    gradient, noise = _in_axes(field, everywhere, everywhere)
    return Displacement(position, vector, field.converged, "px", gradient, noise)


def calibrated_displacement(field: Field, calibration: Calibration) -> Displacement:
    """Return a field's displacements in millimetres of the grid.

    Both ends of a displacement are mapped. A point that was, or went, outside the calibrated area keeps its
    value, which is an extrapolation, but is not valid. The calibration itself counts as free of errors.
    """
    shape = (*field.status.shape, 2)
    before = field.points
    after = before + np.stack([field.u_px, field.v_px], axis=-1).reshape(-1, 2)
    position, moved = calibration.map(before), calibration.map(after)
    inside = calibration.inside(before) & calibration.inside(after)
    here, there = (calibration.jacobian(at).reshape(*shape, 2) for at in (before, after))
    gradient, noise = _in_axes(field, here, there)
    return Displacement(
        position.reshape(shape),
        (moved - position).reshape(shape),
        field.converged & inside.reshape(shape[:2]),
        "mm",
        gradient,
        noise,
    )


def _in_axes(field: Field, here: Float, there: Float) -> tuple[Float, Noise]:
    """Return the gradient and the errors in other axes than the image's.

    `here` and `there`, shape (rows, columns, 2, 2), are the derivatives of the new coordinates by the image's
    before and after the motion: F becomes there · F · here⁻¹.
    """
    shape = field.status.shape
    back = _inverse(here)
    F = field.gradient.reshape(*shape, 2, 2) + np.eye(2)
    gradient = there @ F @ back - np.eye(2)
    both = np.einsum("...ik,...lj->...ijkl", there, back).reshape(*shape, 4, 4)
    by_gradient = both * field.std_gradient[..., None, :]
    spread = there * np.stack([field.std_u_px, field.std_v_px], axis=-1)[..., None, :]
    covariance = by_gradient @ np.swapaxes(by_gradient, -1, -2)
    return gradient, Noise(spread, error_overlap(field.settings), covariance)


def _inverse(matrices: Float) -> Float:
    """Return the inverses (…, 2, 2); where there is none, infinity or NaN instead of an exception."""
    a, b, c, d = (matrices[..., i, j] for i in (0, 1) for j in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.stack([d, -b, -c, a], axis=-1) / (a * d - b * c)[..., None]
    return np.asarray(inverse.reshape(matrices.shape))


def error_overlap(settings: CorrelationSettings) -> Float:
    """Return the correlation of the errors at points of interest that are so many rows and columns apart.

    A subset's displacement is the value at its centre of the shape function that fits its pixels best, hence
    a weighted sum over them: equal weights if it is affine, larger ones in the middle if it is quadratic. Two
    subsets share as much noise as their weights overlap. Their texture, which weighs the pixels as well, is
    taken as even.

    Parameters
    ----------
    settings : CorrelationSettings

    Returns
    -------
    ndarray, shape (m, m)
        1 at [0, 0]; m - 1 steps is as far as subsets overlap.
    """
    from scipy.signal import fftconvolve

    n, r = settings.subset_px, settings.radius_px
    y, x = (axis.ravel() / r for axis in np.mgrid[-r : r + 1, -r : r + 1])
    terms = [np.ones(n * n), x, y]
    if settings.shape == "quadratic":
        terms += [x * x, x * y, y * y]
    weights = np.linalg.pinv(np.column_stack(terms))[0].reshape(n, n)
    shared = fftconvolve(weights, weights)[n - 1 :: settings.step_px, n - 1 :: settings.step_px]
    return np.asarray(shared / shared[0, 0])
