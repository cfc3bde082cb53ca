"""Apply what is known of a specimen's shift towards the camera to the strain that one camera measured."""

from dataclasses import replace

import numpy as np

from dic.out_of_plane.contraction import shown_shift
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.thinning import receded
from dic.out_of_plane.tilt import TiltFit
from dic.out_of_plane.uncertainty import Points
from dic.typing import Float

_UM = 1e3


def with_travel(fit: TiltFit, shift: Shift, points: Points) -> TiltFit:
    """Return a fit whose errors contain the shift that is expected for the corrected strain."""
    if not shift.grows:
        return fit
    larger = (shift.during(points, fit.gradient).std_um / shift.std_um) ** 2
    return replace(fit, parts={**fit.parts, "shift": larger * fit.parts["shift"]})


def without_thinning(
    fit: TiltFit, shift: Shift, poisson_ratio: float, centre_mm: Float
) -> tuple[TiltFit, dict[str, float]]:
    """Return a fit without the false strain of the shift that thinning causes, and this shift for JSON.

    If the thickness of the specimen is not known, the fit does not change.
    """
    if shift.thickness_mm is None:
        return fit, {}
    height_mm = float(fit.plane.to_axes(centre_mm)[2])
    strain_std = float(np.sqrt(np.diag(fit.covariance)[[0, 3]].max()))
    gradient, shift_mm, gain, error = receded(
        fit.gradient, poisson_ratio, shift.thickness_mm, shift.fixed_face, height_mm, strain_std
    )
    parts = {name: gain @ part @ gain.T for name, part in fit.parts.items()}
    parts["shift"] = parts["shift"] + np.outer(error, error)
    std_mm = np.hypot(fit.plane_std[2], height_mm * np.linalg.norm(error) / np.linalg.norm(np.eye(2)))
    new = replace(
        fit,
        gradient=gradient,
        parts=parts,
        mounting=gain @ fit.mounting,
        plane=replace(fit.plane, shift_mm=fit.plane.shift_mm + shift_mm),
        plane_std=np.array([*fit.plane_std[:2], std_mm]),
    )
    return new, {"thinning_um": _UM * shift_mm}


def covering_contraction(
    gradient: Float, parts: dict[str, Float], poisson_ratio: float, height_mm: float
) -> tuple[dict[str, Float], dict[str, float]]:
    """Return covariances (4, 4) by cause that contain the shift which the lateral contraction shows.

    If this shift agrees with the expected shift, the covariances do not change. The further result is the
    shown shift for JSON; it is empty if the specimen may have yielded.
    """
    others = np.sum([part for name, part in parts.items() if name != "shift"], axis=0)
    false = (gradient + np.eye(2)).ravel() / height_mm
    # The trace of the part is the variance of the expected shift times that of the false strain.
    expected_mm = float(np.sqrt(np.trace(parts["shift"]) / (false @ false)))
    shown = shown_shift(gradient, others, poisson_ratio, expected_mm, height_mm)
    if shown is None:
        return parts, {}
    numbers = {
        "contraction_um": _UM * shown.shift_mm,
        "contraction_std_um": _UM * shown.std_mm,
        "contraction_contradicts": float(shown.contradicts),
    }
    if not shown.contradicts:
        return parts, numbers
    missing_mm2 = max(shown.shift_mm**2 - expected_mm**2, 0.0)
    return {**parts, "shift": parts["shift"] + missing_mm2 * np.outer(false, false)}, numbers
