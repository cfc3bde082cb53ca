"""Texts that say why a field or a rotation cannot be corrected, and which part of the rig to check."""

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.diagnosis import in_grid_axes
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tilt import Suspicion
from dic.out_of_plane.uncertainty import Points
from dic.strain.fit import slopes_of
from dic.typing import Float

_CLEARLY = 10.0
"""A cause explains a field if it divides the misfit by this factor, and more than other causes do."""

_ACROSS_SHARE = 0.15
"""If tilts cause the strain, the share of strain across the camera's tilt is at most this."""

_GRIPS_DEG = 0.3
"""Grips seldom tilt a specimen by more than this angle."""

_SAME_SHARE = 0.05
"""Two motions count as equal if their relative difference is at most this."""

_FEWEST_STEPS = 4
_LEAST_TANGENT = 0.1
"""With fewer steps or a smaller tangent of the camera's angle, tilts and strain cannot be distinguished."""


def uneven_reason(misfit: float, limit: float, suspicion: Suspicion, half_width_mm: float, local: str) -> str:
    """Return the reason why no model explains a displacement field in tension.

    `misfit`, `limit`: misfit of the best model, and the largest misfit that counts as explained. `suspicion`:
    fits of strong single causes to the field. `half_width_mm`: half width of the field of points. `local`:
    text about residuals that no smooth field explains; "" without such residuals.
    """
    bent, graded = suspicion.misfit_bent, suspicion.misfit_graded
    if local:
        return (
            f"the motion is not that of one body ({local}): the specimen tears, shears or necks in the "
            "field, so look at local strain"
        )
    if bent < min(misfit / _CLEARLY, graded):
        radius_m = 1e-3 / suspicion.curvature_per_mm
        return (
            f"the specimen bends out of its plane, by a radius of about {radius_m:.2g} m: check that the "
            "specimen is flat and that the grips are in line, or use two cameras"
        )
    if graded < min(misfit / _CLEARLY, bent):
        percent = 100 * abs(suspicion.gradient_per_mm) * half_width_mm
        return (
            "the strain is not uniform, because it has a gradient along the specimen, of about "
            f"{percent:.0f} % from the middle of the field to its edge: move the field away from fillets and "
            "grips"
        )
    return (
        f"the strain is not uniform (a smooth remainder, misfit {misfit:.0f}; noise, tilt, bending and a "
        f"gradient explain at most {limit:.0f}): the specimen may neck or yield in bands, so look at local "
        "strain"
    )


def turned_camera_reason(points: Points, slopes: Float, centre_mm: Float) -> str | None:
    """Return the reason if tilt and motion in the plane together look like a camera that turned.

    A camera that turns about its own centre C sees a specimen that turns about C. If the slopes of this tilt
    are a and b, the specimen also seems to slide by (a, b) Cz. No other cause combines a tilt with exactly
    this slide. Only large tilts are suspected, because grips seldom cause them.

    `slopes`, shape (2,): slopes of the specimen's plane since the reference. `centre_mm`, shape (3,): the
    camera's centre.
    """
    expected_mm = centre_mm[2] * slopes
    if np.degrees(np.hypot(*slopes)) < _GRIPS_DEG:
        return None
    plane = Shift(hinge_mm=(float(centre_mm[0]), float(centre_mm[1]))).plane(*slopes.tolist())
    moved = plane.within(points.after_mm, centre_mm) - points.before_mm
    (_, xy), (yx, _) = slopes_of(points.before_mm, moved)
    turn, to_foot = (yx - xy) / 2, centre_mm[:2] - points.before_mm.mean(axis=0)
    slide_mm = moved.mean(axis=0) + turn * np.array([-to_foot[1], to_foot[0]])
    if np.hypot(*(slide_mm - expected_mm)) > _SAME_SHARE * np.hypot(*expected_mm):
        return None
    return (
        f"the camera turned by about {np.degrees(np.hypot(*slopes)):.2g}° since the reference, because tilt "
        "and slide of the specimen are those of a turn about the camera's centre: fasten the camera and "
        "calibrate again"
    )


def lens_reason(calibrations: tuple[Calibration, Calibration], off_px: float) -> str:
    """Return the reason if the remainder of a lens is as large as the disagreement of two cameras, or ""."""
    remainder_px = max(calibration.lens_remainder_px for calibration in calibrations)
    if remainder_px < off_px:
        return ""
    return (
        f"the cameras disagree by {off_px:.2g} px, and the usual terms of a lens leave {remainder_px:.2g} px "
        "of its distortion: calibrate with more images of the tilted grid, or use a lens with less distortion"
    )


def uncertain_mounting(points: Points, centre_mm: Float) -> str:
    """Return a text that names the motion which makes a tilt in the reference the main uncertainty.

    A tilt in the reference causes false strain if the specimen slides or stretches. A slide s causes a false
    strain of about s/Cz times the tilt. A strain e causes a false strain of e tan θ times the tilt, where θ
    is the camera's off-axis angle.
    """
    slide_mm = float(np.hypot(*(points.after_mm - points.before_mm).mean(axis=0)))
    strain = float(np.abs(slopes_of(points.before_mm, points.after_mm - points.before_mm)).max())
    if slide_mm / centre_mm[2] > strain * np.hypot(*centre_mm[:2]) / centre_mm[2]:
        return (
            f", because the specimen slid by {slide_mm:.2f} mm and may be tilted against the grid: look at "
            "the grips, and attach the grid flat on the specimen"
        )
    return (
        f", because the specimen stretched by {100 * strain:.1f} % and may be tilted against the grid: "
        "attach the grid flat on the specimen"
    )


def not_rigid_reason(
    left: float, calibrated: Float, remaining: Float, angles_deg: Float, centre_mm: Float
) -> str:
    """Return the reason why strain remains in a rotation of a rigid specimen.

    If the specimen tilts in a step, the false strain is along the direction in which the camera is tilted.
    Across this direction there is no false strain. If the specimen is tilted in the reference, the false
    strain across this direction changes with the rotation in a known way. If there is no other strain across
    this direction, the stage's axis tilted differently in each step.

    `left`: remaining strain, rms in standard deviations. `calibrated`, `remaining`, shape (k, 3): strains xx,
    yy, xy in the specimen's axes, before and after the correction. `angles_deg`, shape (k,): rotation of the
    specimen. `centre_mm`, shape (3,): the camera's centre.
    """
    not_rigid = (
        f"the specimen was not rigid, or the camera moved between the images: strain of {left:.1f} standard "
        "deviations (rms) remains"
    )
    tangent = float(np.hypot(*centre_mm[:2]) / centre_mm[2])
    if len(angles_deg) < _FEWEST_STEPS or tangent < _LEAST_TANGENT:
        return not_rigid
    x, y = centre_mm[:2] / np.hypot(*centre_mm[:2])
    to_across = np.array([y * y, x * x, -2 * x * y])
    across = in_grid_axes(angles_deg, calibrated) @ to_across
    # The strains that unit slopes of the specimen in the reference cause, apart from a constant factor.
    by_slope = np.column_stack(
        [
            in_grid_axes(angles_deg, np.tile(unit, (len(angles_deg), 1))) @ to_across
            for unit in ([x, 0.0, y / 2], [0.0, y, x / 2])
        ]
    )
    across = across - by_slope @ np.linalg.lstsq(by_slope, across, rcond=None)[0]
    size = float(np.sqrt(np.mean((remaining**2).sum(axis=1))))
    if np.sqrt(np.mean(across**2)) > _ACROSS_SHARE * size:
        return not_rigid
    return (
        f"the stage's axis wandered by about {np.degrees(size / tangent):.1g}° from step to step: check its "
        "bearing and the seat of the specimen's holder"
    )
