"""The user's data on a tensile test that its record does not contain: area, uncertainties, choices."""

from dataclasses import dataclass

import numpy as np

from dic.errors import Check, CurveError, is_number, require_all
from dic.keywords import named_settings

STRAIN = "strain calibration"
"""Name of the uncertainty that describes a relative error of strain common to all points."""


@named_settings
@dataclass(frozen=True)
class PropertySettings:
    """The specimen's area, the declared uncertainties, and the user's choices for the evaluation rules.

    Attributes
    ----------
    area_mm2 : float
        Original area of the cross-section, mm².
    area_std_mm2, load_std_percent, strain_std_percent : float or None
        Standard deviations of the area, and of load and strain in % of the reading. These errors are common
        to all points. None if an error is unknown; the standard deviations of the results then do not contain
        it.
    offsets_percent : tuple of float
        Plastic strains of the offset yield strengths Rp, %.
    window_mpa : tuple of float, or None
        Stresses between which the elastic slope is fitted; None for the objective window.
    hardening_percent : tuple of float
        Strains between which n and r are fitted, %.

    Raises
    ------
    CurveError
        If a value is not possible.
    """

    area_mm2: float
    area_std_mm2: float | None = None
    load_std_percent: float | None = None
    strain_std_percent: float | None = None
    offsets_percent: tuple[float, ...] = (0.2,)
    window_mpa: tuple[float, float] | None = None
    hardening_percent: tuple[float, float] = (10.0, 20.0)

    def __post_init__(self) -> None:
        remedy = "give width times thickness before the test, such as 120.0"
        checks: list[Check] = [
            (_within(self.area_mm2, 0.0, 1e7), "area", "above 0 mm²", self.area_mm2, remedy)
        ]
        for name, text in (
            ("area_std_mm2", "standard deviation of the area"),
            ("load_std_percent", "standard deviation of the load"),
            ("strain_std_percent", "standard deviation of the strain"),
        ):
            std = getattr(self, name)
            good = std is None or (is_number(std) and 0.0 <= std < 100.0)
            checks.append(
                (good, text, "at least 0", std, "give a small number, such as 0.5, or leave it out")
            )
        given = self.offsets_percent
        listed = isinstance(given, tuple | list) and len(given) > 0
        remedy = "give a tuple of at least one offset, such as (0.2,)"
        checks.append((listed, "offsets", "plastic strains in %", given, remedy))
        for offset in given if listed else ():
            good = _within(offset, 0.0, 10.0)
            checks.append((good, "offset", "above 0 % and below 10 %", offset, "give --offset-percent 0.2"))
        window = self.window_mpa
        good = window is None or (_is_pair(window) and -1.0 < window[0] < window[1] < np.inf)
        remedy = "give the lower and the upper stress, such as 40 160"
        checks.append((good, "window", "a lower and a higher stress in MPa", window, remedy))
        span = self.hardening_percent
        good = _is_pair(span) and 0.0 < span[0] < span[1] < 100.0
        remedy = "give the lower and the upper strain, such as 10 20"
        checks.append((good, "range of hardening", "two strains in %", span, remedy))
        require_all(CurveError, "settings", checks)

    @property
    def stress_share(self) -> float:
        """Standard deviation of the relative error that is common to all stresses."""
        load = (self.load_std_percent or 0.0) / 100.0
        return float(np.hypot(load, (self.area_std_mm2 or 0.0) / self.area_mm2))

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


def _is_pair(values: object) -> bool:
    return isinstance(values, tuple | list) and len(values) == 2 and all(map(is_number, values))


def _within(value: object, low: float, high: float) -> bool:
    return is_number(value) and low < value < high  # type: ignore[operator]
