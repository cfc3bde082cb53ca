"""Errors of displacements that still images of the undeformed specimen show, beyond the noise of images."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dic.typing import Float


@dataclass(frozen=True)
class StillErrors:
    """Smooth errors that haze, vibration, and a camera that moves or warms up cause in every image.

    The errors are sums of orthogonal polynomials, whose mean square over the points is 1. The coefficients of
    both components of the displacement are independent.
    """

    images: int
    """Number of still images from which the errors were estimated."""
    scatter_mm2: tuple[float, ...]
    """Variances of the coefficients of first, second and third degree; those of first degree are strain."""
    drift_mm: tuple[float, ...] = ()
    drift_mm2: tuple[float, ...] = ()
    """Drift of the coefficients in a unit of time, and its variance. The coefficients are those of exx, eyy
    and exy, then those of second and of third degree of both components; none if there is no drift.
    """
    in_seconds: bool = False
    """True if the unit of time is a second, and False if it is the interval between two images."""
    rest_mm: float = 0.0
    """Root mean square of the errors that polynomials of third degree do not contain."""

    def at(self, elapsed: float) -> "StillErrors":
        """Return the errors in an image after the time `elapsed` since the reference."""
        drift_mm = tuple(elapsed * each for each in self.drift_mm)
        return replace(self, drift_mm=drift_mm, drift_mm2=tuple(elapsed**2 * v for v in self.drift_mm2))

    def covariance(self, position_mm: Float, weights: Float) -> Float:
        """Return the covariance (p, p) of p weighted sums of displacements at `position_mm` (n, 2).

        `weights`, shape (n, 2, p): weights of the displacements in the sums. The drift is taken at the unit
        of time.
        """
        # A product of matrices takes a fifth of the time of `numpy.einsum`.
        sums = orthogonal_polynomials(position_mm).T @ weights.reshape(len(weights), -1)
        sums = np.moveaxis(sums.reshape(-1, *weights.shape[1:]), 1, 0)
        variances = np.append(0.0, np.repeat(self.scatter_mm2, (2, 3, 4)))
        covariance = np.einsum("cjp,j,cjq->pq", sums, variances, sums)
        if self.drift_mm:
            drifting = COEFFICIENTS @ sums.reshape(20, -1)
            moved = np.array(self.drift_mm) @ drifting
            covariance = covariance + np.outer(moved, moved)
            covariance = covariance + (drifting.T * np.array(self.drift_mm2)) @ drifting
        return np.asarray(covariance)

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as values for JSON."""
        return vars(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any] | None) -> "StillErrors | None":
        """Return the errors from the values that `as_dict` returned; None for None."""
        if values is None:
            return None
        drift = {name: tuple(values[name]) for name in ("scatter_mm2", "drift_mm", "drift_mm2")}
        return cls(**{**values, **drift})

    def text(self, mm_per_px: float) -> str:
        """Return a sentence about the errors, for a camera with this scale."""
        many = "1 still image shows" if self.images == 1 else f"{self.images} still images show"
        rms_mpx = 1e3 * np.sqrt(np.dot((4, 6, 8), self.scatter_mm2)) / mm_per_px
        drifts = " and a drift" if self.drift_mm else ""
        if rms_mpx < 0.05 and not drifts:
            return f"{many} no errors beyond the noise of the images"
        return f"{many} smooth errors of {rms_mpx:.1f} mpx{drifts}, which all standard deviations contain"


def _coefficients() -> Float:
    each = np.eye(20)
    strains = np.array([each[1], each[12], (each[2] + each[11]) / np.sqrt(2.0)])
    return np.concatenate([strains, each[3:6], each[13:16], each[6:10], each[16:20]])


COEFFICIENTS = _coefficients()
"""Shape (17, 20). Coefficients of exx, eyy and exy, and those of second and third degree, from those of all
ten polynomials for both components. A translation and a rotation are no errors.
"""


def orthogonal_polynomials(position_mm: Float) -> Float:
    """Return ten polynomials of up to third degree at `position_mm` (n, 2), shape (n, 10).

    The polynomials are orthogonal over the points, and have a mean square of 1.
    """
    centred = position_mm - position_mm.mean(axis=0)
    x, y = (centred / np.abs(centred).max()).T
    powers = [(degree - k, k) for degree in range(4) for k in range(degree + 1)]
    basis, triangle = np.linalg.qr(np.stack([x**i * y**j for i, j in powers], axis=1))
    return np.asarray(basis * np.sign(np.diag(triangle)) * np.sqrt(len(x)))
