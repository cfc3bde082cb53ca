"""Choose and apply the method that corrects strain for the motion of the specimen out of the grid's plane."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dic.calibration.calibration import Calibration
from dic.errors import Check, CorrelationError, is_number, require_all
from dic.files.lazy import Computed
from dic.keywords import named_settings
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.rigidity import correct_rotation
from dic.out_of_plane.shift import Shift, shift_checks
from dic.out_of_plane.tension import correct_tilt, declined
from dic.strain.measurement import Measurement

MOTIONS = ("free", "rigid", "tension")
"""Kinds of motion: unknown motion, rotation without strain, and uniform tension with some bending."""

POISSON_RATIO = 0.33


@named_settings
@dataclass(frozen=True)
class Motion:
    """Assumed motion of a specimen, used to correct calibrated strain for out-of-plane motion.

    Attributes
    ----------
    kind : str
        "free" (unknown motion, no correction), "rigid" (rotation without strain) or "tension" (uniform
        stretching with some bending).
    poisson_ratio : float
        Poisson's ratio of the specimen, which determines the shape of a bent specimen in tension.
    alignment : Alignment, optional
        Alignment from an earlier rotation on the same fixture, for the motion "rigid". If an alignment is
        given, the rotated specimen need not be free of strain.
    shift_std_um : float, optional
        Standard deviation of the specimen's shift towards the camera since the reference image. One camera
        cannot measure the shift, so this value enters the standard deviations. Default: 30 µm; 5 µm if
        `tilt_axis_mm` is given.
    tilt_axis_mm : tuple of float, optional
        X and Y of the grips' hinge in the grid's axes: a point at which the specimen's surface keeps its
        height. The shift that a tilt about the hinge causes is then computed, and `shift_std_um` is the
        standard deviation of the remaining shift.

    Raises
    ------
    CorrelationError
        If `kind` is not one of the three motions; if Poisson's ratio is not between 0 and 0.5; if the shift's
        standard deviation is negative; if the hinge is not a pair of numbers; if a hinge is given for the
        motion "rigid"; or if an alignment is given for the motion "free" or "tension".
    """

    kind: str = "free"
    poisson_ratio: float = POISSON_RATIO
    alignment: Alignment | None = None
    shift_std_um: float | None = None
    tilt_axis_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        checks = [
            (
                self.kind in MOTIONS,
                "motion",
                f"one of {', '.join(MOTIONS)}",
                self.kind,
                "give the motion tension or rigid, or free if it is not known",
            ),
            poisson_check(self.poisson_ratio),
            *shift_checks(self.shift_std_um, self.tilt_axis_mm),
            (
                self.alignment is None or self.kind == "rigid",
                "apply alignment",
                "--motion rigid",
                self.kind,
                "give an alignment with --motion rigid only, or leave it out",
            ),
            (
                self.tilt_axis_mm is None or self.kind != "rigid",
                "axis of the tilt",
                "--motion tension",
                self.kind,
                "leave --tilt-axis-mm out, because a rotation stage has no grips",
            ),
        ]
        require_all(CorrelationError, "settings", checks)

    @property
    def shift(self) -> Shift:
        """Knowledge about the specimen's shift towards the camera."""
        return Shift.of(self.shift_std_um, self.tilt_axis_mm)

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as values for JSON."""
        return vars(self) | {"alignment": None if self.alignment is None else self.alignment.as_lists()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Motion":
        """Return the motion from the values that `as_dict` returned."""
        alignment, hinge_mm = values["alignment"], values["tilt_axis_mm"]
        return cls(
            values["kind"],
            values["poisson_ratio"],
            None if alignment is None else Alignment.from_lists(alignment),
            values["shift_std_um"],
            None if hinge_mm is None else (hinge_mm[0], hinge_mm[1]),
        )


def poisson_check(poisson_ratio: float) -> Check:
    """Return the check of a Poisson's ratio in the form that `require_all` needs."""
    return (
        is_number(poisson_ratio) and 0.0 <= poisson_ratio <= 0.5,
        "Poisson's ratio",
        "0 to 0.5",
        poisson_ratio,
        "give a Poisson's ratio of 0.33 for most metals",
    )


@dataclass(frozen=True)
class Corrections:
    """The corrections of one camera's images, in order, and the rotation stage's alignment, or None.

    A correction may be computed, or read from a file, only when it is used.
    """

    images: Sequence[Correction]
    alignment: Alignment | None = None

    def __repr__(self) -> str:
        applied = sum(image.declined is None for image in self.images)
        return f"Corrections({applied} of {len(self.images)} images corrected, {self.alignment})"


def correct(measurements: Sequence[Measurement], calibration: Calibration, motion: Motion) -> Corrections:
    """Correct one camera's images for motion out of the grid's plane; `motion` decides the method.

    Parameters
    ----------
    measurements : sequence of Measurement
        Calibrated measurements with the same reference.
    calibration : Calibration
        Calibration of the camera.
    motion : Motion

    Returns
    -------
    Corrections
        Each correction is computed from the measurement of its image when the correction is used.
    """

    def rotated(k: int) -> Correction:
        found = rotation.corrections[k]
        if found.declined is None:
            return found
        return declined(found.method, measurements[k], calibration, found.declined, motion.shift)

    def tilted(k: int) -> Correction:
        return correct_tilt(measurements[k], calibration, motion.poisson_ratio, motion.shift)

    def unknown(k: int) -> Correction:
        reason = "the specimen's motion is unknown"
        return declined("none", measurements[k], calibration, reason, motion.shift)

    if motion.kind == "rigid":
        rotation = correct_rotation(measurements, calibration, motion.alignment)
        return Corrections(Computed(len(measurements), rotated), rotation.alignment)
    if motion.kind == "tension":
        return Corrections(Computed(len(measurements), tilted))
    return Corrections(Computed(len(measurements), unknown))
