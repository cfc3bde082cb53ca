"""Residuals of a map from image px to grid mm, at the grid points to which the map was fitted."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dic.targets.points import GridPoints
from dic.typing import Float


class PlaneMap(Protocol):
    """A map from image px to mm on the grid's plane."""

    def map(self, px: Float) -> Float:
        """Return the grid coordinates (n, 2) in mm of image points (n, 2) in px."""

    def jacobian(self, px: Float) -> Float:
        """Return the Jacobian ``∂(X, Y)/∂(x, y)`` in mm/px at image points (n, 2), shape (n, 2, 2)."""

    def error_factors(self, px: Float) -> Float:
        """Return a matrix F (2, q), mm, for each of n image points; F Fᵀ is the mapped point's covariance."""


@dataclass(frozen=True)
class Residuals:
    """Mapped minus true positions of grid points.

    Attributes
    ----------
    mm, px : ndarray, shape (n, 2)
        The residuals on the grid in mm, and in the image in px.
    """

    mm: Float
    px: Float

    def __repr__(self) -> str:
        return f"Residuals({len(self.px)} points, rms {self.rms_px:.4f} px, maximum {self.max_px:.4f} px)"

    @classmethod
    def of(cls, plane_map: PlaneMap, grid: GridPoints) -> "Residuals":
        """Return the residuals of a map at grid points, in mm, and converted to px by the map's Jacobian."""
        mm = plane_map.map(grid.uv_px) - grid.xy_mm
        px = np.linalg.solve(plane_map.jacobian(grid.uv_px), mm[:, :, None])[:, :, 0]
        return cls(mm, px.astype(np.float64))

    @property
    def rms_mm(self) -> float:
        """Root mean square length of `mm`."""
        return float(np.sqrt(np.mean(np.sum(self.mm**2, axis=1))))

    @property
    def rms_px(self) -> float:
        """Root mean square length of `px`."""
        return float(np.sqrt(np.mean(np.sum(self.px**2, axis=1))))

    @property
    def max_mm(self) -> float:
        """Largest length of `mm`."""
        return float(np.linalg.norm(self.mm, axis=1).max())

    @property
    def max_px(self) -> float:
        """Largest length of `px`."""
        return float(np.linalg.norm(self.px, axis=1).max())
