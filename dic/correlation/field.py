"""The result of correlation: displacements on a grid of points, and a status for each point."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dic.correlation.interpolation_bias import bias_at, slope_bias_at
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.image.point_grid import PointGrid
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
        These standard deviations do not contain the interpolation bias.
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
        True for pixels of the region of interest; local strain never reaches across its edge. None in a field
        from a result file of an earlier version, in which the region is not stored.
    grid : PointGrid or None
        The points, and the pixels that their subsets used. None in a field from a result file of an earlier
        version, in which these pixels are not stored.
    smoothing_px : float
        Standard deviation of the Gaussian that smoothed both images; 0 if they were not smoothed.
    greatest_bias_px : tuple of float
        Predicted greatest interpolation bias of u and of v, px.
    stored_bias_px : ndarray, shape (rows, columns, 2), or None
        The bias of each point, if it cannot be computed from `warps`, as in a chain of fields. None if the
        bias is computed from `warps`.
    repetition : str
        A sentence that says how the pattern repeats, and what decides between its periods; "" if it does not.
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
    grid: PointGrid | None = None
    smoothing_px: float = 0.0
    greatest_bias_px: tuple[float, float] = (0.0, 0.0)
    stored_bias_px: Float | None = None
    repetition: str = ""

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
        """Standard deviation of `u_px` from noise and interpolation bias, shape (rows, columns)."""
        return np.asarray(np.hypot(self.std[..., 0], self.bias_px[..., 0]))

    @property
    def std_v_px(self) -> Float:
        """Standard deviation of `v_px` from noise and interpolation bias, shape (rows, columns)."""
        return np.asarray(np.hypot(self.std[..., 3], self.bias_px[..., 1]))

    @property
    def noise_std_px(self) -> Float:
        """Standard deviations of u and v from the noise of the images alone, shape (rows, columns, 2)."""
        return self.std[..., [0, 3]]

    @cached_property
    def bias_px(self) -> Float:
        """Predicted interpolation bias of u and v at each point, 0 at failed points, (rows, columns, 2).

        The bias depends on the sub-pixel part of the displacement. The bias is not subtracted from the
        displacement, because its prediction is not exact enough. Instead, the standard deviations `std_u_px`
        and `std_v_px` contain the bias.
        """
        if self.stored_bias_px is not None:
            return self.stored_bias_px
        subset_px = self.settings.subset_px
        biases = [
            bias_at(self.warps[..., k], self.warps[..., k + 1 : k + 3], subset_px, greatest_px)
            for k, greatest_px in zip((0, 3), self.greatest_bias_px, strict=True)
        ]
        return np.nan_to_num(np.stack(biases, axis=-1))

    @property
    def std_gradient(self) -> Float:
        """Standard deviations of `gradient`, shape (rows, columns, 4)."""
        return self.std[..., [1, 2, 4, 5]]

    @cached_property
    def gradient_bias(self) -> Float:
        """Predicted interpolation bias of `gradient`, shape (rows, columns, 4); 0 for a chain of fields."""
        if self.stored_bias_px is not None:
            return np.zeros((*self.status.shape, 4))
        subset_px = self.settings.subset_px
        biases = [
            slope_bias_at(self.warps[..., k], self.warps[..., k + 1 : k + 3], subset_px, greatest_px)
            for k, greatest_px in zip((0, 3), self.greatest_bias_px, strict=True)
        ]
        return np.nan_to_num(np.concatenate(biases, axis=-1))

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
