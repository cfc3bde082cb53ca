"""True stress and strain, the hardening exponent n, the onset of necking, and laws of hardening."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.properties.elastic import Elastic
from dic.properties.record import Record
from dic.properties.settings import PropertySettings
from dic.properties.value import PropertyValue, missing, root_sum
from dic.properties.windows import fit_line, std_of_slope
from dic.properties.yielding import Plateau
from dic.typing import Float

N_RULE = "ln of true stress against ln of true plastic strain (rule of ISO 10275 and ASTM E646)"
NECK_RULE = "true strain at Rm, where the hardening rate falls to the true stress (Considère)"
LEAST_POINTS = 10
FIT_FROM = 0.002
"""Plastic strain from which laws of hardening are fitted."""
MOST_FITTED, MOST_TRIALS = 400, 200


@dataclass(frozen=True)
class TrueCurve:
    """True stress and true strain, up to the end of uniform elongation or of the valid strain."""

    strain: Float
    plastic: Float
    stress: Float
    """Shape (n,). True total strain, true plastic strain, and true stress in MPa."""


def true_curve(record: Record, elastic: Elastic, strength_at: int) -> TrueCurve:
    """Return true stress σ(1 + e) and true strain ln(1 + e), which are valid while the strain is uniform."""
    stop = min(strength_at + 1, record.end)
    strain = record.strain[:stop] - elastic.foot
    total, stress = np.log1p(strain), record.stress[:stop] * (1.0 + strain)
    return TrueCurve(total, total - stress / elastic.line.slope, stress)


def hardening_range(
    record: Record, elastic: Elastic, settings: PropertySettings, strength_at: int
) -> tuple[slice, dict[str, Any]] | str:
    """Return the part of the record from which n and r are computed, and its window; or why there is none."""
    low, high = settings.hardening_percent
    strain = 100 * (record.strain - elastic.foot)
    until = min(strength_at, record.end - 1)
    upper = min(high, float(strain[until]))
    if upper <= low:
        cause = f" ({record.end_reason})" if record.end_reason and strength_at >= record.end else ""
        return f"uniform strain is known up to {upper:.1f} %, and the range begins at {low:g} %{cause}"
    inside = np.flatnonzero((strain[: until + 1] >= low) & (strain[: until + 1] <= upper))
    if len(inside) < LEAST_POINTS:
        return f"few points: {len(inside)} between {low:g} % and {upper:g} % of strain"
    window = {"strain_percent": [low, upper], "points": len(inside)}
    return slice(int(inside[0]), int(inside[-1]) + 1), window


def hardening_exponent(curve: TrueCurve, part: slice, window: dict[str, Any]) -> PropertyValue:
    """Return the hardening exponent n, which a common relative error of all stresses does not change."""
    plastic, stress = curve.plastic[part], curve.stress[part]
    if (plastic <= 0.0).any() or len(plastic) < LEAST_POINTS:
        return missing("1", N_RULE, "the plastic strain is not positive throughout the range")
    x, y = np.log(plastic), np.log(stress)
    line = fit_line(x, y, 0, len(x))
    if line.slope <= 0.0:
        return missing("1", N_RULE, "the true stress does not rise in the range")
    std = std_of_slope(x, y, line)
    middle = len(x) // 2
    halves = [fit_line(x, y, *each).slope for each in ((0, middle + 1), (middle - 1, len(x)))]
    bend = halves[1] - halves[0]
    flags = (f"curvature: n of the range's halves differs by {bend:+.3f}",) if abs(bend) > 0.05 else ()
    return PropertyValue(line.slope, root_sum(std, bend / 4.0), "1", N_RULE, window, flags)


def necking(record: Record, agt: PropertyValue) -> PropertyValue:
    """Return the true strain at which necking begins."""
    if agt.value is None or agt.std is None:
        return missing("1", NECK_RULE, agt.flags[0].removeprefix("missing: "))
    total = 1.0 + agt.value / 100.0
    window = {"true_stress_mpa": float(record.stress[record.top]) * total}
    return PropertyValue(float(np.log(total)), agt.std / 100.0 / total, "1", NECK_RULE, window)


def hardening_laws(curve: TrueCurve, plateau: Plateau | None) -> dict[str, dict[str, Any]]:
    """Fit the laws of Ramberg and Osgood, Swift, and Voce to the true curve.

    Result: for each law its formula, parameters with standard deviations, range of plastic strain, and the
    root mean square of the residual stress, MPa; or "flags" with the reason why it was not fitted.
    """
    begin = plateau.last if plateau is not None else 0
    at = begin + np.flatnonzero(curve.plastic[begin:] >= FIT_FROM)
    at = at[:: max(1, len(at) // MOST_FITTED)]
    plastic, stress = curve.plastic[at], curve.stress[at]
    if len(at) < LEAST_POINTS or np.ptp(plastic) < FIT_FROM:
        names = ("ramberg_osgood", "swift", "voce")
        return {
            name: {"flags": ["missing: few points with plastic strain beyond yielding"]} for name in names
        }
    top, first = float(stress.max()), float(stress[0])
    laws = {
        "swift": _fit(
            "stress = K (strain_0 + plastic)^n",
            lambda e, k, zero, n: k * np.maximum(zero + e, 1e-12) ** n,
            {"K_mpa": 1.5 * top, "strain_0": 0.01, "n": 0.2},
            (plastic, stress),
        ),
        "voce": _fit(
            "stress = A + Q (1 - exp(-b plastic))",
            lambda e, a, q, b: a + q * -np.expm1(-b * e),
            {
                "A_mpa": max(first, 0.01 * top),
                "Q_mpa": max(top - first, 1.0),
                "b": 1.0 / float(np.ptp(plastic)),
            },
            (plastic, stress),
        ),
    }
    if plateau is not None:
        reason = "missing: the law is continuous and does not describe a yield plateau"
        return {"ramberg_osgood": {"flags": [reason]}, **laws}
    law = _fit(
        "strain = stress / E + 0.002 (stress / S)^N",
        lambda e, yield_mpa, n: yield_mpa * (e / 0.002) ** (1.0 / n),
        {"S_mpa": max(first, 0.01 * top), "N": 10.0},
        (plastic, stress),
    )
    return {"ramberg_osgood": law, **laws}


def _fit(
    formula: str, law: Callable[..., Float], start: dict[str, float], data: tuple[Float, Float]
) -> dict[str, Any]:
    """Fit positive parameters of a law to plastic strain and true stress."""
    from scipy.optimize import curve_fit

    plastic, stress = data
    try:
        found, covariance = curve_fit(
            law,
            plastic,
            stress,
            list(start.values()),
            bounds=(0.0, np.inf),
            x_scale=list(start.values()),
            max_nfev=MOST_TRIALS,
        )
    except RuntimeError as error:
        # scipy raises a RuntimeError if the fit does not converge.
        return {"formula": formula, "flags": [f"missing: the fit did not converge ({error})"]}
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rest = stress - law(plastic, *found)
    return {
        "formula": formula,
        "parameters": {
            name: {"value": float(value), "std": float(std) if np.isfinite(std) else None}
            for name, value, std in zip(start, found, stds, strict=True)
        },
        "plastic_strain": [float(plastic.min()), float(plastic.max())],
        "residual_mpa": float(np.sqrt(np.mean(rest**2))),
        "flags": [],
    }
