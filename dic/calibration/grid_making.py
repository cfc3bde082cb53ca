"""How accurately a calibration target was made.

A printer feeds paper by another length than it moves its light, and not quite at a right angle to it. Paper
and its glue are not flat.
"""

from typing import Any

from dic.errors import CalibrationError
from dic.settings import Number, declared_in, one_of, setting, settings_class

_MOST_SHEAR, _MOST_BOW_MM = 0.05, 1.0

ACCURACIES = {"printed": (7e-4, 5e-4, 0.02), "glass": (1e-5, 1e-5, 0.001), "exact": (0.0, 0.0, 0.0)}
"""Standard deviations of scale ratio, skew and flatness (mm) of targets that are made in different ways.

Printed: by a laser printer on paper or film, glued to a plate. Glass: chrome on glass, by lithography.
"""

GRID_MADE: Any = setting(
    "making of the target",
    "How the target was made: printed (by a laser printer, on paper or film), glass (chrome on glass), or"
    " exact. Default: as the run file says, otherwise printed.",
    default=None,
    expected=one_of(ACCURACIES),
    remedy="give --grid-made glass for chrome on glass, or leave it out",
    example='"glass"',
    metavar="MAKING",
    read=str,
    among=(None, *ACCURACIES),
)


def _std(what: str, sentence: str, option: str, most: float, unit: str = "") -> Any:
    return setting(
        f"standard deviation of the target's {what}",
        f"Standard deviation of {sentence}. Default: by the way in which the target was made.",
        default=None,
        expected=f"0 to {most:g}{unit}",
        remedy=f"give {option} 0 for an exact target, or a larger value",
        option=option,
        example=str(most / 100),
        check=lambda std: std is None or 0.0 <= std <= most,
    )


SCALE_RATIO_STD = _std(
    "scale ratio", "the ratio of the target's scales along X and Y", "--scale-ratio-std", _MOST_SHEAR
)
SKEW_STD = _std("skew", "the angle between the target's axes, rad", "--skew-std", _MOST_SHEAR, " rad")
FLATNESS_STD = _std(
    "flatness", "the height of a bow at the target's edge, mm", "--flatness-std-mm", _MOST_BOW_MM, " mm"
)


@settings_class(CalibrationError)
class GridAccuracy:
    """How accurately a calibration target was made."""

    grid_made: str | None = GRID_MADE
    scale_ratio_std: Number | None = SCALE_RATIO_STD
    skew_std: Number | None = SKEW_STD
    flatness_std_mm: Number | None = FLATNESS_STD

    @property
    def stds(self) -> tuple[float, float, float]:
        """Standard deviations of scale ratio, skew (rad) and flatness (mm)."""
        stated = self.scale_ratio_std, self.skew_std, self.flatness_std_mm
        usual = ACCURACIES[self.grid_made or "printed"]
        ratio, skew, flatness_mm = (
            by_making if std is None else std for std, by_making in zip(stated, usual, strict=True)
        )
        return ratio, skew, flatness_mm

    @property
    def std(self) -> tuple[float, ...]:
        """Standard deviations of the deviations that `dic.calibration.grid_accuracy` names."""
        ratio, skew, flatness_mm = self.stds
        return ratio, skew, *3 * [flatness_mm]


EXACT = GridAccuracy("exact")
MAKING = tuple(declared_in(GridAccuracy))
"""Names of the settings of `GridAccuracy`, which run files have too."""
