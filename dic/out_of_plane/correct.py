"""Which correction fits which motion of a specimen."""

from collections.abc import Sequence
from dataclasses import dataclass

from dic.calibration.calibration import Calibration
from dic.errors import CorrelationError
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.rigidity import correct_rotation
from dic.out_of_plane.tension import correct_tilt
from dic.strain.measurement import Measurement

MOTIONS = ("free", "rigid", "tension")
"""What may be known of a specimen's motion: nothing; that it is rotated without strain; that it is stretched
uniformly, with some bending."""

POISSON_RATIO = 0.33


def require_poisson_ratio(poisson_ratio: float) -> None:
    """Refuse a Poisson's ratio that no metal has.

    Raises
    ------
    CorrelationError
    """
    if not 0.0 <= poisson_ratio <= 0.5:
        raise CorrelationError(
            "settings", "Poisson's ratio", "0 to 0.5", f"{poisson_ratio:g}", "correct --poisson-ratio"
        )


@dataclass(frozen=True)
class Corrections:
    """The corrections of the images of one camera, in order, and the alignment they rest on, if any."""

    images: list[Correction]
    alignment: Alignment | None = None


def correct(
    motion: str,
    measurements: Sequence[Measurement],
    calibration: Calibration,
    *,
    poisson_ratio: float = POISSON_RATIO,
    alignment: Alignment | None = None,
) -> Corrections:
    """Correct one camera's images for motion out of the grid's plane, as far as the motion tells it.

    Parameters
    ----------
    motion : str
        "free", "rigid" or "tension".
    measurements : sequence of Measurement
        Calibrated, all of the same reference.
    calibration : Calibration
        Of their camera.
    poisson_ratio : float
        Of the specimen, for the shape of its bending in tension.
    alignment : Alignment, optional
        Of the same fixture, solved before: for rotations, whose specimen need not be rigid then.

    Raises
    ------
    CorrelationError
        If there is no such motion.
    """
    if motion not in MOTIONS:
        raise CorrelationError(
            "settings", "motion", f"one of {', '.join(MOTIONS)}", str(motion), "correct the setting"
        )
    if motion == "rigid":
        rotation = correct_rotation(measurements, calibration, alignment)
        return Corrections(rotation.corrections, rotation.alignment)
    if motion == "tension":
        return Corrections([correct_tilt(m, calibration, poisson_ratio) for m in measurements])
    reason = "nothing is known of the specimen's motion"
    return Corrections([Correction.refused("none", m, reason) for m in measurements])
