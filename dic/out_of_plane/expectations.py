"""The expectations for a specimen in tension before the measurement: prior standard deviations of all causes.

One camera cannot distinguish all causes of `dic.out_of_plane.causes`. If the images do not determine a cause,
its size comes from these expectations, and the uncertainty of the cause enters the standard deviations. The
expectations are those of a flat specimen in ordinary grips. For tilt, bending, curvature and strain gradient
there are several levels, from nearly zero to large. Each combination of levels is one model;
`dic.out_of_plane.evidence` weighs the models.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np

from dic.out_of_plane.causes import SIZES, places
from dic.typing import Float, Mask

TILT_STD = float(np.tan(np.radians(0.1)))
"""Standard deviation of each slope of the specimen in the reference, and of its change; typical for grips."""

GAP_STD_MM = 0.3
"""Standard deviation of the distance between the specimen's surface and the grid's plane, mm."""

CURVATURE_STD_PER_MM = 1e-5
"""Standard deviation of the curvature if it is not measured, which corresponds to a radius of 100 m."""

_TILTS = {TILT_STD / 100: 0.15, TILT_STD / 10: 0.25, TILT_STD: 0.6}
"""Levels of the tilt since the reference, and their prior probabilities."""

_BENDINGS_PER_MM = (0.0, 1e-5, 1e-4)
_CURVATURES_PER_MM = (0.0, 1e-5, 3.3e-5, 1e-4)
_CURVED_PROBABILITY = 0.5
_GRADIENTS = (0.0, 0.02, 0.05, 0.15)
"""Change of the strain from the middle of the field to its edge, as a fraction of the strain."""

_GRADIENT_PROBABILITY = 0.5
_WIDE = 100.0
_TAPER_SHARE = 0.5
"""Standard deviation of the field "taper", as a fraction of that of the field "gradient".

For a tapered specimen in plane stress, the fraction is (2 + ν)/2 = 1.2; without shear it is ν/2.
"""


@dataclass(frozen=True)
class Expectations:
    """The prior standard deviations of the causes in each model."""

    std: Float
    """Shape (models, 19). Prior standard deviations in the order and units of
    `dic.out_of_plane.causes.fields`.
    """
    log_prior: Float
    """Shape (models,). Logarithms of the prior probabilities of the models."""
    curved: Mask
    graded: Mask
    """Shape (models,). True for models with out-of-plane curvature, and with a gradient of the strain."""

    @classmethod
    def of(cls, shift_std_mm: float, half_width_mm: float) -> "Expectations":
        """Return the expectations for a strain of 1, for a field of points with the given half width."""
        return _of_unit_width(shift_std_mm).scaled(1.0 / half_width_mm)

    def scaled(self, strain: float) -> "Expectations":
        """Return the expectations for a given strain; the gradients are proportional to this strain."""
        std, at = self.std.copy(), places()
        for name in ("gradient", "taper"):
            std[:, at[name]] *= abs(strain)
        return replace(self, std=std)

    def wide(self) -> "Expectations":
        """Return the expectations with a hundred times larger curvature and gradient of the strain."""
        std, at = self.std.copy(), places()
        for name in ("tilt", "curvature", "gradient", "taper"):
            std[:, at[name]] *= _WIDE
        return replace(self, std=std)

    def only(self, *, curved: bool, graded: bool) -> "Expectations":
        """Return the models with or without curvature, and with or without a gradient."""
        some = (self.curved == curved) & (self.graded == graded)
        return Expectations(self.std[some], self.log_prior[some], self.curved[some], self.graded[some])

    def kind(self, model: int) -> tuple[bool, bool]:
        """Return whether a model has curvature, and whether it has a gradient."""
        return bool(self.curved[model]), bool(self.graded[model])


@lru_cache(maxsize=16)
def _of_unit_width(shift_std_mm: float) -> Expectations:
    """Return the expectations for a strain of 1, for a field with a half width of 1 mm."""
    at, rows, logs, curved, graded = places(), [], [], [], []
    levels = product(_TILTS, _BENDINGS_PER_MM, _CURVATURES_PER_MM, _GRADIENTS, (0.0, _TAPER_SHARE))
    for tilt, bending, curvature, gradient, taper in levels:
        if taper and not gradient:
            continue
        std = np.zeros(sum(SIZES.values()))
        std[at["affine"]] = np.inf
        own = {
            "bending": bending,
            "tilt": tilt,
            "mounted tilt": TILT_STD,
            "gap": GAP_STD_MM,
            "shift": shift_std_mm,
            "curvature": curvature,
            "gradient": gradient,
            "taper": taper * gradient,
        }
        for name, value in own.items():
            std[at[name]] = value
        rows.append(std)
        logs.append(np.log(_TILTS[tilt]) + _log_prior(curvature, gradient))
        curved.append(curvature > 0)
        graded.append(gradient > 0)
    return Expectations(np.array(rows), np.array(logs), np.array(curved), np.array(graded))


def _log_prior(curvature: float, gradient: float) -> float:
    """Return the logarithm of the prior probability of a curvature and a gradient, up to a constant."""
    bent = _CURVED_PROBABILITY / (len(_CURVATURES_PER_MM) - 1)
    # With a gradient there are two models, without and with taper.
    uneven = _GRADIENT_PROBABILITY / (2 * (len(_GRADIENTS) - 1))
    return float(
        np.log(bent if curvature else 1 - _CURVED_PROBABILITY)
        + np.log(uneven if gradient else 1 - _GRADIENT_PROBABILITY)
    )


def unmeasured(shift_std_mm: float) -> Float:
    """Return the standard deviations (19,) of the causes out of the plane if none of them is measured."""
    at, std = places(), np.zeros(sum(SIZES.values()))
    std[at["tilt"]] = std[at["mounted tilt"]] = TILT_STD
    std[at["gap"]], std[at["shift"]] = GAP_STD_MM, shift_std_mm
    std[at["curvature"]] = CURVATURE_STD_PER_MM
    return std
