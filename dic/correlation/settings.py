"""Settings of the correlation, which are checked before any image is read."""

from dic.errors import CorrelationError, is_number
from dic.settings import Number, Whole, either, number_or_text, setting, settings_class

AUTO = "auto"
"""Value of `CorrelationSettings.smoothing_px` with which the program chooses the smoothing."""

_WIDEST_SMOOTHING_PX = 5.0

ORDERS = (3, 5)
"""Degrees of the spline that interpolates the images."""

SHAPES = {"affine": 6, "quadratic": 12}
"""Shape functions and the number of their parameters."""


def _is_smoothing(value: float | str) -> bool:
    return value == AUTO or (is_number(value) and 0.0 <= float(value) <= _WIDEST_SMOOTHING_PX)


@settings_class(CorrelationError)
class CorrelationSettings:
    """Settings of the correlation."""

    subset_px: Whole = setting(
        "subset",
        "Width of the square subsets, odd, px.",
        default=41,
        expected="an odd number, at least 7 px",
        remedy="give a subset between 11 and 101 px, odd",
        option="--subset",
        check=lambda width: width % 2 == 1,
        ge=7,
    )
    step_px: Whole = setting(
        "step",
        "Spacing of the points, px.",
        default=10,
        expected="a whole number, at least 1 px",
        remedy="give a step of about a quarter of the subset, such as 10 px",
        option="--step",
        ge=1,
    )
    shape: str = setting(
        "shape function",
        f"Shape function: {either(SHAPES)}.",
        default="quadratic",
        expected=either(SHAPES),
        remedy="give the shape quadratic, which follows strain that changes within a subset",
        more="A quadratic one follows strain that changes within a subset, and the perspective of a camera"
        " that looks at an angle. At equal subset width, the displacements have about twice as much noise.",
        among=SHAPES,
    )
    order: Whole = setting(
        "spline order",
        f"Degree of the spline that interpolates the images, {either(ORDERS)}.",
        default=5,
        expected=either(ORDERS),
        remedy="give the order 5",
        option="--spline",
        among=ORDERS,
    )
    min_zncc: Number = setting(
        "smallest ZNCC",
        "Smallest correlation (ZNCC, zero-mean normalised cross-correlation) of a good point.",
        default=0.8,
        expected="between 0 and 1",
        remedy="give a smallest ZNCC of 0.8",
        gt=0.0,
        lt=1.0,
    )
    tolerance_px: Number = setting(
        "tolerance",
        "Iterations end when a step moves the subset's edge by less than this, px.",
        default=1e-4,
        expected="above 0 px, up to 1 px",
        remedy="give a tolerance of 0.0001 px",
        more="They also end when all further steps together are predicted to move the edge by less.",
        gt=0.0,
        le=1.0,
    )
    max_iterations: Whole = setting(
        "iterations",
        "Largest number of iterations for each attempt at a point.",
        default=40,
        expected="a whole number, at least 1",
        remedy="give 40 iterations",
        ge=1,
    )
    smoothing_px: Number | str = setting(
        "smoothing",
        "Width (standard deviation) of the smoothing of all images before interpolation, px: a number,"
        " 0 for none, or auto (only if the pattern needs it).",
        default=AUTO,
        expected=f"auto, or between 0 and {_WIDEST_SMOOTHING_PX:g} px",
        remedy="give auto to smooth only patterns that need it, or 0 for no smoothing",
        more='With "auto", images are smoothed only if the predicted interpolation bias is above 0.001 px,'
        " and only as strongly as is necessary to reduce the bias to this value.",
        option="--smoothing",
        read=number_or_text,
        check=_is_smoothing,
    )

    @property
    def parameters(self) -> int:
        """Number of parameters of a warp: 6 for affine, 12 for quadratic."""
        return SHAPES[self.shape]

    @property
    def radius_px(self) -> int:
        """Number of pixels of the subset on either side of its centre."""
        return self.subset_px // 2


INCREMENTAL = ("auto", "never", "always")


@settings_class(CorrelationError)
class ReferenceSettings:
    """The rule for new references in a series of images."""

    incremental: str = setting(
        "incremental correlation",
        "When to take a new reference image: auto (when correlation drops), never, or always (each image).",
        default="auto",
        expected=" or ".join(INCREMENTAL),
        remedy="give auto to take a new reference where the correlation drops",
        among=INCREMENTAL,
    )
