"""Settings of the strain: the strain measure and the source of the local strain."""

from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.settings import Whole, either, one_of, setting, settings_class
from dic.strain.measures import MEASURES

SOURCES = ("fit", "quadratic-fit", "shape")
"""Sources of local strain: a fitted plane, a fitted quadratic surface, or the subset's shape function."""


@settings_class(CorrelationError)
class StrainSettings:
    """Settings of the strain: the strain measure and the source of the local strain."""

    measure: str = setting(
        "strain measure",
        f"Strain measure: {either(MEASURES)}.",
        default="green-lagrange",
        expected=one_of(MEASURES),
        remedy="give green-lagrange, which a rigid rotation does not change",
        option="--strain",
        among=MEASURES,
    )
    window_points: Whole = setting(
        "strain window",
        "Width of the strain window in points, odd.",
        default=3,
        expected="an odd number of points, at least 3",
        remedy="give a strain window between 3 and 21 points, odd",
        more="A plane or a surface is fitted to the window for each local strain.",
        option="--strain-window",
        check=lambda width: width % 2 == 1,
        ge=3,
    )
    source: str = setting(
        "source of local strain",
        "Source of local strain: fit (plane in the strain window), quadratic-fit, or shape (function).",
        default="fit",
        expected=one_of(SOURCES),
        remedy="give fit, a plane through the points of the window",
        option="--strain-from",
        among=SOURCES,
    )

    def gauge_px(self, correlation: CorrelationSettings) -> int:
        """Return the width, px, of the virtual strain gauge: the area that determines one local strain."""
        if self.source == "shape":
            return correlation.subset_px
        return (self.window_points - 1) * correlation.step_px + correlation.subset_px
