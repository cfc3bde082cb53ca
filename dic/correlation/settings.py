"""Settings of the correlation, which are checked before any image is read."""

from dataclasses import dataclass

from dic.errors import Check, CorrelationError, is_number, is_whole, require_all
from dic.image.spline import ORDERS
from dic.keywords import named_settings

AUTO = "auto"
"""Value of `CorrelationSettings.smoothing_px` with which the program chooses the smoothing."""

_WIDEST_SMOOTHING_PX = 5.0

SHAPES = {"affine": 6, "quadratic": 12}
"""Shape functions and the number of their parameters."""


@named_settings
@dataclass(frozen=True)
class CorrelationSettings:
    """Settings of the correlation.

    Attributes
    ----------
    subset_px : int
        Width of the square subset, an odd number.
    step_px : int
        Spacing of the points of interest.
    shape : str
        Shape function, "quadratic" or "affine". A quadratic shape function follows strain that changes within
        a subset, and the perspective of a camera that looks at an angle. At equal subset width, the
        displacements have about twice as much noise as with an affine shape function.
    order : int
        Degree of the B-spline that interpolates the images, 3 or 5.
    min_zncc : float
        Smallest ZNCC (zero-mean normalised cross-correlation) of a converged point.
    tolerance_px : float
        Iterations end when a step moves the subset's edge by less than `tolerance_px`. Iterations also end
        when all further steps together are predicted to move the edge by less than `tolerance_px`.
    max_iterations : int
        Largest number of iterations for each attempt at a point.
    smoothing_px : float or str
        Standard deviation of the Gaussian that smooths both images before they are interpolated; 0 for no
        smoothing. With "auto", images are smoothed only if the predicted interpolation bias is above 0.001
        px, and the smoothing is only as strong as is necessary to reduce the bias to this value.
    """

    subset_px: int = 41
    step_px: int = 10
    shape: str = "quadratic"
    order: int = 5
    min_zncc: float = 0.8
    tolerance_px: float = 1e-4
    max_iterations: int = 40
    smoothing_px: float | str = AUTO

    def __post_init__(self) -> None:
        checks: list[Check] = [
            (
                is_whole(self.subset_px) and self.subset_px % 2 == 1 and self.subset_px >= 7,
                "subset",
                "an odd number, at least 7 px",
                self.subset_px,
                "give a subset between 11 and 101 px, odd",
            ),
            (
                is_whole(self.step_px) and self.step_px >= 1,
                "step",
                "a whole number, at least 1 px",
                self.step_px,
                "give a step of about a quarter of the subset, such as 10 px",
            ),
            (
                self.shape in SHAPES,
                "shape function",
                "affine or quadratic",
                self.shape,
                "give the shape quadratic, which follows strain that changes within a subset",
            ),
            (
                self.order in ORDERS,
                "spline order",
                "3 or 5",
                self.order,
                "give the order 5",
            ),
            (
                is_number(self.min_zncc) and 0.0 < self.min_zncc < 1.0,
                "smallest ZNCC",
                "between 0 and 1",
                self.min_zncc,
                "give a smallest ZNCC of 0.8",
            ),
            (
                is_number(self.tolerance_px) and 0.0 < self.tolerance_px <= 1.0,
                "tolerance",
                "above 0 px, up to 1 px",
                self.tolerance_px,
                "give a tolerance of 0.0001 px",
            ),
            (
                is_whole(self.max_iterations) and self.max_iterations >= 1,
                "iterations",
                "a whole number, at least 1",
                self.max_iterations,
                "give 40 iterations",
            ),
            (
                self.smoothing_px == AUTO or _is_smoothing(self.smoothing_px),
                "smoothing",
                f"auto, or between 0 and {_WIDEST_SMOOTHING_PX:g} px",
                self.smoothing_px,
                "give auto to smooth only patterns that need it, or 0 for no smoothing",
            ),
        ]
        require_all(CorrelationError, "settings", checks)

    @property
    def parameters(self) -> int:
        """Number of parameters of a warp: 6 for affine, 12 for quadratic."""
        return SHAPES[self.shape]

    @property
    def radius_px(self) -> int:
        """Number of pixels of the subset on either side of its centre."""
        return self.subset_px // 2


def _is_smoothing(value: float | str) -> bool:
    return is_number(value) and 0.0 <= float(value) <= _WIDEST_SMOOTHING_PX
