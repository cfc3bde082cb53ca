"""The result of correlation: displacements on a grid of points, and a status for each point."""

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
        Coordinates of the columns and of the rows of points in the reference.
    warps : ndarray, shape (rows, columns, 6 or 12)
        The warp of each point: the displacements u and v with their first derivatives, in the order (u, u_x,
        u_y, v, v_x, v_y). A quadratic shape function adds (u_xx, u_xy, u_yy, v_xx, v_xy, v_yy). The warp of a
        failed point is NaN.
    std : ndarray, shape (rows, columns, 6)
        Standard deviations of the first six warp parameters, from the noise of the images and the Hessian.
    zncc : ndarray, shape (rows, columns)
        Correlation coefficient of each point (zero-mean normalised cross-correlation).
    iterations : ndarray of int, shape (rows, columns)
        Number of iterations at each point.
    status : ndarray of int8, shape (rows, columns)
        Status of each point, a value of `Status`.
    active : ndarray of bool, shape (rows, columns)
        True for points in the region of interest. Other points were not correlated.
    start : str
        Source of the first guess: "previous", "hint", "search" or "features".
    settings : CorrelationSettings
        Settings of the correlation.
    updates : int
        Number of new references between the first reference and this image. Each new reference increases
        `std`.
    region : ndarray of bool, shape (height, width), or None
        True for pixels of the region of interest; local strain never reaches across its edge. None if the
        region is not known, such as in a field that was read from a result file.
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
    region: Mask | None = None

    def __repr__(self) -> str:
        converged = f"{self.count(Status.CONVERGED)} of {self.in_view} points in view converged"
        settings = f"subset {self.settings.subset_px} px, step {self.settings.step_px} px"
        return f"Field({converged}, {settings}, start from {self.start})"

    @property
    def u_px(self) -> Float:
        """Displacement to the right, px, shape (rows, columns)."""
        return self.warps[..., 0]

    @property
    def v_px(self) -> Float:
        """Displacement downwards, px, shape (rows, columns)."""
        return self.warps[..., 3]

    @property
    def gradient(self) -> Float:
        """Displacement gradient u_x, u_y, v_x, v_y at the points, shape (rows, columns, 4)."""
        return self.warps[..., [1, 2, 4, 5]]

    @property
    def std_u_px(self) -> Float:
        """Standard deviation of `u_px`, shape (rows, columns)."""
        return self.std[..., 0]

    @property
    def std_v_px(self) -> Float:
        """Standard deviation of `v_px`, shape (rows, columns)."""
        return self.std[..., 3]

    @property
    def std_gradient(self) -> Float:
        """Standard deviations of `gradient`, shape (rows, columns, 4)."""
        return self.std[..., [1, 2, 4, 5]]

    @property
    def converged(self) -> Mask:
        """A mask that is True for converged points, shape (rows, columns)."""
        return np.asarray(self.active & (self.status == Status.CONVERGED), np.bool_)

    @property
    def points(self) -> Float:
        """Coordinates (x, y) of all points of the grid in the reference, shape (rows * columns, 2)."""
        x, y = np.meshgrid(self.x_px, self.y_px)
        return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)

    def count(self, status: Status) -> int:
        """Return the number of points in the region of interest that have the given status."""
        return int(np.count_nonzero(self.active & (self.status == status)))

    @property
    def in_view(self) -> int:
        """Number of points in the region of interest whose subset stays inside the deformed image."""
        return int(np.count_nonzero(self.active)) - self.count(Status.OUT_OF_VIEW)
