"""What correlation gives: displacements on a grid of points, each with the reason if it failed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.typing import Float, Indices, Mask


@dataclass(frozen=True)
class Field:
    """Displacements on the grid of points of interest, in pixels.

    Attributes
    ----------
    x_px, y_px : ndarray of int, shapes (columns,) and (rows,)
        Where the points are in the reference.
    warps : ndarray, shape (rows, columns, 6 or 12)
        (u, u_x, u_y, v, v_x, v_y) per point, followed by (u_xx, u_xy, u_yy, v_xx, v_xy, v_yy) if the shape
        function is quadratic; NaN where the point failed.
    std : ndarray, shape (rows, columns, 6)
        Standard deviations of the first six, from the noise of the images and the Hessian.
    zncc : ndarray, shape (rows, columns)
    iterations : ndarray of int, shape (rows, columns)
    status : ndarray of int8, shape (rows, columns)
        Values of `Status`.
    active : ndarray of bool, shape (rows, columns)
        Which points lie in the region of interest; the others were not tried.
    start : str
        Where the first guess came from: "previous", "hint", "search" or "features".
    settings : CorrelationSettings
        How the images were correlated.
    updates : int
        How many times the reference was updated on the way; each update adds to `std`.
    """

    x_px: Indices
    y_px: Indices
    warps: Float
    std: Float
    zncc: Float
    iterations: NDArray[np.int16]
    status: NDArray[np.int8]
    active: Mask
    start: str
    settings: CorrelationSettings
    updates: int = 0

    def __repr__(self) -> str:
        converged = f"{self.count(Status.CONVERGED)} of {self.in_view} points in view converged"
        settings = f"subset {self.settings.subset_px} px, step {self.settings.step_px} px"
        return f"Field({converged}, {settings}, start from {self.start})"

    @property
    def u_px(self) -> Float:
        """Displacement to the right, (rows, columns)."""
        return self.warps[..., 0]

    @property
    def v_px(self) -> Float:
        """Displacement downwards, (rows, columns)."""
        return self.warps[..., 3]

    @property
    def gradient(self) -> Float:
        """Derivatives u_x, u_y, v_x, v_y at the points, (rows, columns, 4)."""
        return self.warps[..., [1, 2, 4, 5]]

    @property
    def std_u_px(self) -> Float:
        """Standard deviation of `u_px`, (rows, columns)."""
        return self.std[..., 0]

    @property
    def std_v_px(self) -> Float:
        """Standard deviation of `v_px`, (rows, columns)."""
        return self.std[..., 3]

    @property
    def std_gradient(self) -> Float:
        """Standard deviations of `gradient`, (rows, columns, 4)."""
        return self.std[..., [1, 2, 4, 5]]

    @property
    def converged(self) -> Mask:
        """Which points have a value, (rows, columns)."""
        return np.asarray(self.active & (self.status == Status.CONVERGED), np.bool_)

    @property
    def points(self) -> Float:
        """All points (x, y) of the grid in the reference, (rows * columns, 2)."""
        x, y = np.meshgrid(self.x_px, self.y_px)
        return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)

    def count(self, status: Status) -> int:
        """Return how many points of the region have this status."""
        return int(np.count_nonzero(self.active & (self.status == status)))

    @property
    def in_view(self) -> int:
        """Points of the region whose subset stays in the deformed image."""
        return int(np.count_nonzero(self.active)) - self.count(Status.OUT_OF_VIEW)
