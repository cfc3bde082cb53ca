"""How accurately the calibration grid was made: deviations that its lines share.

A printer feeds paper by another length than it moves its light, and not quite at a right angle to it. Paper
and its glue are not flat. All grid points share these deviations, so the residuals of one image hardly show
them. Several images of the tilted grid do.
"""

from dataclasses import dataclass, replace

import numpy as np

from dic.errors import CalibrationError, is_number, require_all
from dic.typing import Float, Mask

_MOST_SHEAR, _MOST_BOW_MM = 0.05, 1.0

DEVIATIONS = ("scale ratio", "skew", "bow along X", "twist", "bow along Y")
"""Names of the deviations g that a fit of a pinhole camera estimates, in their order.

The scale ratio g₁ and the skew g₂ move a point in the grid's plane:

    X = x (1 + g₁/2) + y g₂/2,    Y = y (1 − g₁/2) + x g₂/2

The other three, in mm, bend the grid with the half widths a and b:

    Z = g₃ (x²/a² − 1/3) + g₄ x y/(a b) + g₅ (y²/b² − 1/3)
"""


@dataclass(frozen=True)
class GridAccuracy:
    """Standard deviations of the grid's deviations from its nominal shape.

    Attributes
    ----------
    scale_ratio_std : float
        Of the ratio of the scales along X and Y, minus 1.
    skew_std : float
        Of the deviation of the angle between the lines from 90°, in rad.
    flatness_std_mm : float
        Of the height of a bow at the edge of the grid.

    Raises
    ------
    CalibrationError
        If a value is negative, or larger than 0.05 or 1 mm. The message lists all mistakes.
    """

    scale_ratio_std: float = 7e-4
    skew_std: float = 5e-4
    flatness_std_mm: float = 0.02

    def __post_init__(self) -> None:
        values = [
            ("scale ratio", "--scale-ratio-std", self.scale_ratio_std, _MOST_SHEAR, ""),
            ("skew", "--skew-std", self.skew_std, _MOST_SHEAR, " rad"),
            ("flatness", "--flatness-std-mm", self.flatness_std_mm, _MOST_BOW_MM, " mm"),
        ]
        checks = [
            (
                is_number(value) and 0 <= value <= most,
                f"standard deviation of the grid's {name}",
                f"0 to {most:g}{unit}",
                f"{value}{unit}",
                f"give {option} 0 for an exact grid, or a larger value",
            )
            for name, option, value, most, unit in values
        ]
        require_all(CalibrationError, "settings", checks)

    @classmethod
    def of(cls, made: str, **stated: float | None) -> "GridAccuracy":
        """Return the accuracy of a grid made in one of the ways `ACCURACIES`, with values that are stated."""
        return replace(
            ACCURACIES[made], **{name: value for name, value in stated.items() if value is not None}
        )

    @property
    def std(self) -> Float:
        """Standard deviations of `DEVIATIONS`, shape (5,)."""
        return np.array([self.scale_ratio_std, self.skew_std, *3 * [self.flatness_std_mm]])


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


PRINTED = GridAccuracy()
"""A laser printer's grid on paper or film, glued to a plate."""

GLASS = GridAccuracy(1e-5, 1e-5, 0.001)
"""Chrome on glass, made by lithography."""

EXACT = GridAccuracy(0.0, 0.0, 0.0)
FLAT = KnownGrid.of(EXACT)

ACCURACIES = {"printed": PRINTED, "glass": GLASS}


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
