"""Displacements in axes with y up, raw in pixels or calibrated in millimetres, with their errors.

The errors are those that image noise causes, to first order, and the interpolation bias. If two subsets
overlap, they share pixels, so the errors from noise of their displacements are correlated. The interpolation
bias depends on the sub-pixel part of the displacement and is correlated over the whole field.
"""

from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.image.stored import is_large
from dic.strain.error_overlap import ClippedSubsets, clipped_subsets, error_overlap
from dic.strain.sight import Sight, shared_sight
from dic.typing import Float, Mask

_UPWARDS = np.diag([1.0, -1.0])


@dataclass(frozen=True)
class Noise:
    """The errors of displacements that image noise and interpolation cause.

    Attributes
    ----------
    factors : ndarray, shape (rows, columns, 2, 2)
        A matrix F for each point, in the unit of the displacement. The error from noise is F·e, where the two
        elements of the vector e are independent random numbers of variance 1. The covariance of this error is
        F Fᵀ.
    overlap : ndarray, shape (m, n)
        Element [i, j] is the correlation between the errors of two points that are i rows and j columns of
        the grid apart, if both subsets are whole: they use all their pixels. The errors of points that are
        farther apart are not correlated.
    gradient : ndarray, shape (rows, columns, 4, 4)
        Covariance matrix of the displacement gradient that the shape function gives at each point; NaN if it
        is not known. The gradient's elements are in the order xx, xy, yx, yy.
    bias : ndarray, shape (rows, columns, 2, 2), or None
        A matrix B for each point, in the unit of the displacement. The error from interpolation is B·b, where
        the two elements of b are independent random numbers of variance 1 that all points share. None if
        there is no such error.
    clipped : ClippedSubsets or None
        Correlations of the errors of points whose subset is not whole; None if all subsets count as whole.
    """

    factors: Float
    overlap: Float
    gradient: Float
    bias: Float | None = None
    clipped: ClippedSubsets | None = None

    def __repr__(self) -> str:
        rows, columns = self.gradient.shape[:2]
        return f"Noise({rows} × {columns} points)"

    def mapped(self, there: Float, gradient: Float) -> "Noise":
        """Return the errors in new coordinates.

        Parameters
        ----------
        there : ndarray, shape (rows, columns, 2, 2)
            Derivatives of the new coordinates with respect to the old ones.
        gradient : ndarray, shape (rows, columns, 4, 4)
            Covariance matrix of the displacement gradient in the new coordinates.
        """
        bias = None if self.bias is None else there @ self.bias
        return replace(self, factors=there @ self.factors, gradient=gradient, bias=bias)

    def of_bias(self) -> "Noise":
        """Return the errors that interpolation alone causes."""
        # Arrays of one repeated element take no memory.
        factors, gradient = (np.broadcast_to(0.0, of.shape) for of in (self.factors, self.gradient))
        return replace(self, factors=factors, gradient=gradient)


@dataclass(frozen=True)
class Displacement:
    """Reference positions and displacements of material points.

    The x axis points to the right and the y axis up, also for displacements in pixels. Therefore raw and
    calibrated strains have the same signs.

    Attributes
    ----------
    position, vector : ndarray, shape (rows, columns, 2)
        Reference position and displacement of every point of interest; NaN where they are not known.
    valid : ndarray of bool, shape (rows, columns)
        True for points that may be used for strain. Such points have converged. For calibrated displacements,
        such points also lie inside the calibrated area.
    unit : str
        Unit of positions and displacements, "px" or "mm".
    gradient : ndarray, shape (rows, columns, 2, 2), or None
        Displacement gradient ∂u_i/∂x_j within each point's subset, from the shape function. None if the local
        strain does not come from shape functions.
    noise : Noise or None
        Errors of the displacements; None if they are not known.
    sight : Sight or None
        Object that finds out which neighbours of a point lie on the same piece of the surface. None if the
        region is not known.
    """

    position: Float
    vector: Float
    valid: Mask
    unit: str
    gradient: Float | None = None
    noise: Noise | None = None
    sight: Sight | None = None

    def __repr__(self) -> str:
        return f"Displacement({int(self.valid.sum())} of {self.valid.size} points valid, {self.unit})"


NOWHERE = Displacement(np.empty((0, 0, 2)), np.empty((0, 0, 2)), np.empty((0, 0), np.bool_), "px")
"""A displacement that has no points."""


def raw_displacement(field: Field, *, gradients: bool = True) -> Displacement:
    """Return the displacements of a correlated image in pixels, with the y axis up.

    If `gradients` is False, the result has no gradient, and the covariances of its gradients are NaN. Only
    the strain from shape functions needs them. They take long to compute, and more memory than all the rest.
    """
    shape = (*field.status.shape, 2)
    vector = np.stack([field.u_px, -field.v_px], axis=-1)
    position = (field.points * np.array([1.0, -1.0])).reshape(shape)
    everywhere = np.broadcast_to(_UPWARDS, (*shape, 2))
    gradient, noise = _in_axes(field, everywhere if gradients else None, everywhere)
    return Displacement(position, vector, field.converged, "px", gradient, noise, sight_of(field))


def calibrated_displacement(
    field: Field, calibration: Calibration, *, gradients: bool = True
) -> Displacement:
    """Return the displacements of a correlated image in millimetres on the calibration grid's plane.

    The calibration maps the start and the end of each displacement from pixels to millimetres. If the start
    or the end is outside the calibrated area, the displacement is extrapolated. An extrapolated displacement
    keeps its value, but is not used for strain (`valid` is False). The errors do not include errors of the
    calibration. `gradients` is as for `raw_displacement`.
    """
    shape = (*field.status.shape, 2)
    before = field.points
    after = before + np.stack([field.u_px, field.v_px], axis=-1).reshape(-1, 2)
    position, inside = calibration.on_points(field.x_px, field.y_px)
    moved, there = calibration.map_and_jacobian(after)
    here = calibration.jacobian(before).reshape(*shape, 2) if gradients else None
    gradient, noise = _in_axes(field, here, there.reshape(*shape, 2))
    inside = inside & calibration.inside(after)
    return Displacement(
        position.reshape(shape),
        (moved - position).reshape(shape),
        field.converged & inside.reshape(shape[:2]),
        "mm",
        gradient,
        noise,
        sight_of(field),
    )


def calibrated_noise(field: Field, calibration: Calibration) -> Noise:
    """Return the errors of `calibrated_displacement`; the covariances of its gradients are NaN."""
    after = field.points + np.stack([field.u_px, field.v_px], axis=-1).reshape(-1, 2)
    return displacement_noise(field, calibration.jacobian(after).reshape(*field.status.shape, 2, 2))


def displacement_noise(field: Field, there: Float) -> Noise:
    """Return the errors of displacements in new coordinates; the covariances of gradients are NaN.

    `there`, shape (rows, columns, 2, 2): derivatives of the new coordinates with respect to the image
    coordinates, after the motion.
    """
    # In the layout for the compiled fit: where `there` is a broadcast array, NumPy would choose another one.
    factors, bias = (
        np.multiply(there, each[..., None, :], order="C") for each in (field.noise_std_px, field.bias_px)
    )
    unknown = np.broadcast_to(np.nan, (*field.status.shape, 4, 4))
    clipped = None if field.grid is None else clipped_subsets(field.grid, field.settings)
    return Noise(factors, error_overlap(field.settings), unknown, bias, clipped)


def sight_of(field: Field) -> Sight | None:
    """Return the `Sight` of a field, which finds out which points see each other; None without a region."""
    if field.region is None:
        return None
    sight = Sight(field.region, field.x_px, field.y_px)
    # Nothing is kept of a large region, so the region is not kept either. A mask that can be changed may be
    # another region the next time.
    return sight if is_large(field.region.shape) or field.region.flags.writeable else shared_sight(sight)


def _in_axes(field: Field, here: Float | None, there: Float) -> tuple[Float | None, Noise]:
    """Return the displacement gradient and the errors of a correlated image in new coordinates.

    The arrays `here` and `there`, shape (rows, columns, 2, 2), are the derivatives of the new coordinates
    with respect to the image coordinates, before and after the motion. In the new coordinates the deformation
    gradient F becomes ``there · F · here⁻¹``. If `here` is None, there is no gradient, and its covariances
    are NaN.
    """
    if here is None:
        return None, displacement_noise(field, there)
    shape = field.status.shape
    back = _inverse(here)
    F = field.gradient.reshape(*shape, 2, 2) + np.eye(2)
    gradient = there @ F @ back - np.eye(2)
    both = np.einsum("...ik,...lj->...ijkl", there, back).reshape(*shape, 4, 4)
    by_gradient = both * field.std_gradient[..., None, :]
    covariance = by_gradient @ np.swapaxes(by_gradient, -1, -2)
    for part in (slice(0, 2), slice(2, 4)):
        # The biases of u and of v are independent of each other. The bias of u changes both derivatives of u
        # together.
        error = both[..., part] @ field.gradient_bias[..., part, None]
        covariance += error @ np.swapaxes(error, -1, -2)
    return gradient, replace(displacement_noise(field, there), gradient=covariance)


def _inverse(matrices: Float) -> Float:
    """Return the inverses of matrices of shape (…, 2, 2); a singular matrix gives infinity or NaN."""
    a, b, c, d = (matrices[..., i, j] for i in (0, 1) for j in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.stack([d, -b, -c, a], axis=-1) / (a * d - b * c)[..., None]
    return np.asarray(inverse.reshape(matrices.shape))
