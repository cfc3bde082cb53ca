"""How to correlate, checked before anything is read."""

from dataclasses import dataclass

from dic.errors import CorrelationError, require_all
from dic.image.spline import ORDERS

SHAPES = {"affine": 6, "quadratic": 12}
"""Shape functions and the number of their parameters."""


@dataclass(frozen=True)
class CorrelationSettings:
    """How to correlate.

    Attributes
    ----------
    subset_px : int
        Width of the square subset, odd.
    step_px : int
        Distance of the points of interest.
    shape : str
        Shape function, "affine" or "quadratic". Quadratic ones follow strain that changes within a subset, at
        about twice the noise.
    order : int
        B-spline order of the interpolation, 3 or 5.
    min_zncc : float
        Below it a point is not trusted.
    tolerance_px : float
        Iterations end when a step moves no pixel of the subset's edge by more than this.
    max_iterations : int
    """

    subset_px: int = 31
    step_px: int = 10
    shape: str = "affine"
    order: int = 5
    min_zncc: float = 0.8
    tolerance_px: float = 1e-4
    max_iterations: int = 40

    def __post_init__(self) -> None:
        checks = [
            (
                self.subset_px % 2 == 1 and self.subset_px >= 7,
                "subset",
                "an odd width of at least 7 px",
                self.subset_px,
                "give a subset of 31 px",
            ),
            (self.step_px >= 1, "step", "at least 1 px", self.step_px, "give a step of 10 px"),
            (
                self.shape in SHAPES,
                "shape function",
                "affine or quadratic",
                self.shape,
                "give the shape affine",
            ),
            (self.order in ORDERS, "spline order", "3 or 5", self.order, "give the order 5"),
            (
                0.0 < self.min_zncc < 1.0,
                "smallest ZNCC",
                "between 0 and 1",
                self.min_zncc,
                "give a smallest ZNCC of 0.8",
            ),
            (
                self.tolerance_px > 0.0,
                "tolerance",
                "above 0 px",
                self.tolerance_px,
                "give a tolerance of 1e-4 px",
            ),
            (self.max_iterations >= 1, "iterations", "at least 1", self.max_iterations, "give 40 iterations"),
        ]
        require_all(CorrelationError, "settings", checks)

    @property
    def parameters(self) -> int:
        """Parameters of a warp: 6 or 12."""
        return SHAPES[self.shape]

    @property
    def radius_px(self) -> int:
        """Pixels of the subset on either side of its centre."""
        return self.subset_px // 2
