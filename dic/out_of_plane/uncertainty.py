"""Covariances of estimates that are weighted sums of displacements.

A least-squares estimate is, to first order, a weighted sum of displacements. The error of the estimate is the
same weighted sum of the displacements' errors. These errors have three sources. The noise of the images gives
correlated errors to points whose subsets overlap. Interpolation gives errors that vary slowly over the field.
The errors of the calibration are common to all points.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dic.calibration.calibration import Calibration
from dic.image.threads import bands_of
from dic.out_of_plane.map_errors import MapErrors, in_order
from dic.out_of_plane.nodes import Nodes
from dic.out_of_plane.plane import Plane
from dic.strain.displacement import Displacement
from dic.strain.fit import covariance_of_sums, slopes_of
from dic.strain.mean_in_blocks import MANY_POINTS, covariances_in_blocks
from dic.strain.still import StillErrors
from dic.typing import Float, Mask

_SMOOTH_PX = 0.0004
"""Errors of the displacement due to interpolation, px, measured by benchmarks.order on rendered images.

These errors contain the interpolation bias, which is also predicted from the pattern of each image.
Interpolation errors change with the sub-pixel part of the displacement, so neighbouring points have similar
errors.
"""

_SOME_POINTS = 50_000
"""Number of points whose errors by the calibration are computed at a time."""

_DETERMINED = 1e8
"""Largest accepted condition number of the normal equations."""


@dataclass(frozen=True)
class Points:
    """The usable points of a displacement field, and the errors of weighted sums of their displacements."""

    displacement: Displacement
    """Calibrated displacement, in mm."""
    use: Mask
    """Shape (rows, columns). True for the n points that are used: converged points inside the calibrated
    area.
    """
    px: Float
    """Shape (2, n, 2). Image points in the reference and in the deformed image."""
    calibration: Calibration
    surface: Plane = field(default_factory=Plane)
    """Plane of the specimen's surface in the reference. Displacements are along this plane."""
    seen_from_mm: Float | None = None
    """Shape (3,). The camera's centre in the grid's axes, if it is known better than from the calibration."""
    still: StillErrors | None = None
    """Errors that still images show."""

    @cached_property
    def before_mm(self) -> Float:
        """Calibrated positions of the points in the reference, shape (n, 2)."""
        return self.displacement.position[self.use]

    @cached_property
    def after_mm(self) -> Float:
        """Calibrated positions of the points in the deformed image, shape (n, 2)."""
        return self.before_mm + self.displacement.vector[self.use]

    @cached_property
    def mean_gradient(self) -> Float:
        """Mean displacement gradient of the calibrated displacements, shape (2, 2)."""
        return slopes_of(self.before_mm, self.after_mm - self.before_mm)

    @property
    def centre_mm(self) -> Float:
        """The camera's centre, shape (3,), in the axes of the surface: two axes within it, and its normal."""
        return self.surface.to_axes(self.grid_centre_mm)

    @property
    def grid_centre_mm(self) -> Float:
        """The camera's centre in the grid's axes, shape (3,)."""
        if self.seen_from_mm is not None:
            return self.seen_from_mm
        if self.calibration.pinhole is None:
            raise ValueError("this calibration knows no camera centre")
        return self.calibration.pinhole.centre_mm

    def determine(self, degree: int) -> bool:
        """Return True if the points determine polynomials of the given degree."""
        powers = [(total - k, k) for total in range(degree + 1) for k in range(total + 1)]
        if len(self.before_mm) <= len(powers):
            return False
        centred = self.before_mm - self.before_mm.mean(axis=0)
        x, y = (centred / max(float(np.abs(centred).max()), 1e-12)).T
        design = np.column_stack([x**i * y**j for i, j in powers])
        return bool(np.linalg.cond(design.T @ design) < _DETERMINED)

    def noise_covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) that image noise causes in p weighted sums of the displacements.

        `weights`, shape (n, 2, p): weights of the displacements in the sums.
        """
        if self.displacement.noise is None:
            raise ValueError("the noise of these displacements is unknown")
        noise, first = self.displacement.noise, np.append(0, np.cumsum(self.use.sum(axis=1)))

        def on_grid(rows: slice) -> Float:
            placed = np.zeros((*self.use[rows].shape, *weights.shape[1:]))
            placed[self.use[rows]] = weights[first[rows.start] : first[rows.stop]]
            return placed

        if self.use.size * weights.shape[2] <= 4 * MANY_POINTS:
            return covariance_of_sums(on_grid(slice(0, len(self.use))), noise)
        by_noise, by_bias = covariances_in_blocks(on_grid, weights.shape[2], noise, self.use.shape)
        return by_noise + by_bias

    def smooth_covariance(self, weights: Float, degree: int = 2, smooth_px: float | None = None) -> Float:
        """Return the covariance (p, p) that interpolation causes in p weighted sums of the displacements.

        Interpolation errors depend on the sub-pixel part of the displacement. In a strained specimen, this
        sub-pixel part varies slowly over the field. So the errors are modelled as polynomials from first
        degree to `degree`. The polynomials have the value `smooth_px` at the outermost points. The noise of
        the displacements already contains the predicted interpolation bias, so the variance of the bias is
        subtracted here.

        `weights`, shape (n, 2, p): weights of the displacements in the sums. `degree`: degree of the
        polynomials. `smooth_px`: size of the errors. Default: the errors of rendered images.
        """
        centred = self.before_mm - self.before_mm.mean(axis=0)
        x, y = (centred / np.abs(centred).max()).T
        size_mm = self.smooth_mm(smooth_px)
        powers = [(total - k, k) for total in range(1, degree + 1) for k in range(total + 1)]
        terms = size_mm * np.stack([x**i * y**j for i, j in powers], axis=1)
        factors = (weights.reshape(len(weights), -1).T @ terms).reshape(2, weights.shape[2], -1)
        factors = np.concatenate(list(factors), axis=1)
        return np.asarray(factors @ factors.T)

    def smooth_mm(self, smooth_px: float | None = None) -> float:
        """Return the size of the errors of `smooth_covariance`, mm."""
        whole_mm = (_SMOOTH_PX if smooth_px is None else smooth_px) * self.calibration.mm_per_px
        return float(np.sqrt(max(whole_mm**2 - self._bias_mm2, 0.0)))

    def still_covariance(self, weights: Float) -> Float:
        """Return the covariance (p, p) of p weighted sums by the errors that still images show."""
        if self.still is None:
            return np.zeros((weights.shape[2],) * 2)
        return self.still.covariance(self.before_mm, weights)

    @property
    def _bias_mm2(self) -> float:
        """Mean variance of the predicted interpolation bias, per component of the displacement, mm²."""
        noise = self.displacement.noise
        if noise is None or noise.bias is None:
            return 0.0
        return float((noise.bias[self.use] ** 2).sum(axis=(1, 2)).mean() / 2)

    def adjusted(self, sources: Float) -> Displacement:
        """Return the displacements if the calibration has errors of the given sizes (q,).

        The errors are those of `calibration_factors`.
        """
        errors = MapErrors.of(self.calibration)
        position, vector = self.displacement.position.copy(), self.displacement.vector.copy()
        position[self.use] = errors.adjusted(self.before_mm, sources)
        vector[self.use] = errors.adjusted(self.after_mm, sources) - position[self.use]
        return replace(self.displacement, position=position, vector=vector)

    def calibration_factors(self, weights: Float) -> tuple[Float, Float]:
        """Return the effect of calibration errors on weighted sums of displacements and on camera centres.

        The calibration has q independent sources of error with variance 1. Each column of the results belongs
        to one source, and to the same source for all fields with the same calibration. For the pinhole model,
        errors of the map and of the camera's centre are correlated: a grid that appears too large gives a
        camera that is too near. For the bicubic map, the errors are assumed to be independent of the centre.

        `weights`, shape (n, 2, p): weights of the displacements in the sums; or shape (n, r): those of each
        component in r of the p = 2 r sums, as for `of_both_components`.

        Returns
        -------
        of_map : ndarray, shape (p, q)
            A matrix F for the p weighted sums. The errors of the map give these sums the covariance F Fᵀ.
        of_centre : ndarray, shape (3, q)
            The corresponding matrix F for the three coordinates of the camera's centre, mm.
        """
        if self.calibration.pinhole is None:
            raise ValueError("this calibration knows no camera centre")
        # With the deformation gradient F, an error dx of the reference position changes the expected deformed
        # position by F dx.
        F = self.mean_gradient + np.eye(2)
        errors_of = self.calibration.error_factors
        of_map = sums_of(errors_of, self.px[1], weights) - sums_of(
            lambda px: F @ errors_of(px), self.px[0], weights
        )
        of_map, of_centre = in_order(of_map, self.calibration), self.calibration.pinhole.centre_factors()
        more = of_map.shape[1] - of_centre.shape[1]
        return of_map, np.pad(of_centre, ((0, 0), (more, 0)))


def sums_of(function: Callable[[Float], Float], position: Float, weights: Float) -> Float:
    """Return weighted sums (p, …) of a smooth function over points at `position` (n, 2).

    `function`: returns vectors (k, 2, …) at k positions. `weights`: as for `of_both_components`.
    """
    nodes = Nodes.of(position, weights)
    values = function(nodes.at)
    if np.isfinite(values).all():
        return weighted_sums(of_both_components(nodes.weights), values)
    # A corner of the area lies outside the image of the lens.
    parts = bands_of(len(weights), _SOME_POINTS)
    sums = [weighted_sums(of_both_components(weights[some]), function(position[some])) for some in parts]
    return np.asarray(np.sum(sums, axis=0))


def of_both_components(weights: Float) -> Float:
    """Return weights (n, 2, 2 r): those of `weights` (n, r) for each component, first of x and then of y.

    Weights of the shape (n, 2, p) are returned as they are.
    """
    if weights.ndim == 3:
        return weights
    count = weights.shape[1]
    both = np.zeros((len(weights), 2, 2 * count))
    both[:, 0, :count] = both[:, 1, count:] = weights
    return both


def weighted_sums(weights: Float, field: Float) -> Float:
    """Return p weighted sums of a displacement field, or of k fields.

    `weights` has the shape (n, 2, p). `field` has the shape (n, 2) or (n, 2, k).

    The result has the shape (p,) or (p, k).
    """
    # A product of matrices takes a fifth of the time of `numpy.einsum`.
    sums = weights.reshape(-1, weights.shape[2]).T @ field.reshape(2 * len(field), -1)
    return np.asarray(sums.reshape(-1, *field.shape[2:]))


def block_diagonal(blocks: Sequence[Float]) -> Float:
    """Return the matrix with the given blocks on its diagonal and 0 elsewhere."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))
