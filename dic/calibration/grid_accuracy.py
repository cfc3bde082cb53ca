"""How accurately the calibration grid was made: deviations that its lines share.

A printer feeds paper by another length than it moves its light, and not quite at a right angle to it. Paper
and its glue are not flat. All grid points share these deviations, so the residuals of one image hardly show
them. Several images of the tilted grid do.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.errors import CalibrationError
from dic.settings import Number, one_of, setting, settings_class
from dic.typing import Float, Mask

_MOST_SHEAR, _MOST_BOW_MM = 0.05, 1.0

DEVIATIONS = ("scale ratio", "skew", "bow along X", "twist", "bow along Y")
"""Names of the deviations g that a fit of a pinhole camera estimates, in their order.

The scale ratio g₁ and the skew g₂ move a point in the grid's plane:

    X = x (1 + g₁/2) + y g₂/2,    Y = y (1 − g₁/2) + x g₂/2

The other three, in mm, bend the grid with the half widths a and b:

    Z = g₃ (x²/a² − 1/3) + g₄ x y/(a b) + g₅ (y²/b² − 1/3)
"""


ACCURACIES = {"printed": (7e-4, 5e-4, 0.02), "glass": (1e-5, 1e-5, 0.001), "exact": (0.0, 0.0, 0.0)}
"""Standard deviations of scale ratio, skew and flatness (mm) of grids that are made in different ways.

Printed: a laser printer's grid on paper or film, glued to a plate. Glass: chrome on glass, by lithography.
"""


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


@settings_class(CalibrationError)
class GridAccuracy:
    """How accurately a calibration target was made."""

    made: str | None = setting(
        "making of the target",
        "How the target was made: printed (by a laser printer, on paper or film), glass (chrome on glass), or"
        " exact. Default: as the run file says, otherwise printed.",
        default=None,
        expected=one_of(ACCURACIES),
        remedy="give --grid-made glass for chrome on glass, or leave it out",
        option="--grid-made",
        example='"glass"',
        metavar="MAKING",
        read=str,
        among=(None, *ACCURACIES),
    )
    scale_ratio_std: Number | None = _std(
        "scale ratio", "the ratio of the target's scales along X and Y", "--scale-ratio-std", _MOST_SHEAR
    )
    skew_std: Number | None = _std(
        "skew", "the angle between the target's axes, rad", "--skew-std", _MOST_SHEAR, " rad"
    )
    flatness_std_mm: Number | None = _std(
        "flatness",
        "the height of a bow at the target's edge, mm",
        "--flatness-std-mm",
        _MOST_BOW_MM,
        " mm",
    )

    @property
    def stds(self) -> tuple[float, float, float]:
        """Standard deviations of scale ratio, skew (rad) and flatness (mm)."""
        stated = self.scale_ratio_std, self.skew_std, self.flatness_std_mm
        usual = ACCURACIES[self.made or "printed"]
        ratio, skew, flatness = (
            by_making if std is None else std for std, by_making in zip(stated, usual, strict=True)
        )
        return ratio, skew, flatness

    @property
    def std(self) -> Float:
        """Standard deviations of `DEVIATIONS`, shape (5,)."""
        ratio, skew, flatness_mm = self.stds
        return np.array([ratio, skew, *3 * [flatness_mm]])


@dataclass(frozen=True)
class KnownGrid:
    """What is known of a grid's deviations before a fit."""

    mean: Float
    """Shape (5,). Expected deviations."""
    covariance: Float
    """Shape (5, 5). Their covariance; 0 for deviations that the grid does not have."""

    @classmethod
    def of(cls, accuracy: GridAccuracy) -> "KnownGrid":
        """Return what the accuracy of a grid tells."""
        return cls(np.zeros(len(DEVIATIONS)), np.diag(accuracy.std**2))

    @property
    def free(self) -> Mask:
        """Shape (5,). True for the deviations that the grid may have."""
        return np.diag(self.covariance) > 0

    @property
    def weights(self) -> Float:
        """Matrix W, shape (k, 5), for which W (g − mean) are k independent deviations with variance 1."""
        free = self.free
        weights = np.zeros((np.count_nonzero(free), len(free)))
        weights[:, free] = np.linalg.cholesky(np.linalg.inv(self.covariance[np.ix_(free, free)])).T
        return weights


EXACT = GridAccuracy("exact")
FLAT = KnownGrid.of(EXACT)


def deviated(xy_mm: Float, half_mm: Float, deviations: Float) -> tuple[Float, Float]:
    """Return the true places (n, 3), mm, of grid points (n, 2), and their derivatives (n, 3, 5).

    `half_mm`, shape (2,): half widths of the grid along X and Y.
    """
    x, y = xy_mm.T
    slopes = np.zeros((len(x), 3, len(DEVIATIONS)))
    slopes[:, 0, 0], slopes[:, 1, 0] = x / 2, -y / 2
    slopes[:, 0, 1], slopes[:, 1, 1] = y / 2, x / 2
    across, up = (xy_mm / half_mm).T
    slopes[:, 2, 2:] = np.stack([across**2 - 1 / 3, across * up, up**2 - 1 / 3], axis=1)
    return np.column_stack([xy_mm, np.zeros(len(x))]) + slopes @ deviations, slopes
