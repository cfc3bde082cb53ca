"""The user's data on a tensile test that its record does not contain: area, uncertainties, choices."""

from math import hypot, inf
from typing import Any

from dic.errors import CurveError
from dic.settings import Number, Numbers, Pair, setting, settings_class

STRAIN = "strain calibration"
"""Name of the uncertainty that describes a relative error of strain common to all points."""


def _std(what: str, sentence: str) -> Any:
    """Declare the standard deviation of an error that is common to all points; None if it is not known."""
    return setting(
        f"standard deviation of the {what}",
        sentence,
        default=None,
        expected="at least 0",
        remedy="give a small number, such as 0.5, or leave it out",
        check=lambda std: std is None or 0.0 <= std < 100.0,
    )


@settings_class(CurveError)
class PropertySettings:
    """The specimen's area, the declared uncertainties, and the user's choices for the evaluation rules.

    The uncertainties are common to all points. The standard deviations of the results do not contain those
    that are None.
    """

    area_mm2: Number = setting(
        "area",
        "Area of the cross-section before the test, mm².",
        expected="above 0 mm²",
        remedy="give width times thickness before the test, such as 120.0",
        gt=0.0,
        lt=1e7,
    )
    area_std_mm2: Number | None = _std("area", "Standard deviation of the area, mm².")
    load_std_percent: Number | None = _std("load", "Standard deviation of the load cell, % of the load.")
    strain_std_percent: Number | None = _std(
        "strain", "Standard deviation of the strain's calibration, % of the strain."
    )
    offsets_percent: Numbers = setting(
        "offset",
        "Another offset of Rp beside 0.2 %; may be repeated.",
        default=(0.2,),
        expected="plastic strains above 0 % and below 10 %",
        remedy="give --offset-percent 0.2",
        option="--offset-percent",
        several=True,
        check=lambda offsets: bool(offsets) and all(0.0 < offset < 10.0 for offset in offsets),
    )
    window_mpa: Pair | None = setting(
        "window",
        "Fit E between two stresses instead of in the objective window.",
        default=None,
        expected="a lower and a higher stress in MPa",
        remedy="give the lower and the upper stress, such as 40 160",
        metavar="LOW HIGH",
        check=lambda window: window is None or -1.0 < window[0] < window[1] < inf,
    )
    hardening_percent: Pair = setting(
        "range of hardening",
        "Strains between which n and r are fitted, %.",
        default=(10.0, 20.0),
        expected="two strains in %",
        remedy="give the lower and the upper strain, such as 10 20",
        metavar="LOW HIGH",
        check=lambda span: 0.0 < span[0] < span[1] < 100.0,
    )

    @property
    def stress_share(self) -> float:
        """Standard deviation of the relative error that is common to all stresses."""
        load = (self.load_std_percent or 0.0) / 100.0
        return hypot(load, (self.area_std_mm2 or 0.0) / self.area_mm2)

    @property
    def strain_share(self) -> float:
        """Standard deviation of the relative error that is common to all strains."""
        return (self.strain_std_percent or 0.0) / 100.0

    @property
    def not_counted(self) -> list[str]:
        """Names of the uncertainties that the user did not declare."""
        names = {
            "area": self.area_std_mm2,
            "load cell": self.load_std_percent,
            STRAIN: self.strain_std_percent,
        }
        return [name for name, std in names.items() if std is None]
