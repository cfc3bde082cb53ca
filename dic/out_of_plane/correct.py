"""Choose and apply the method that corrects strain for the motion of the specimen out of the grid's plane."""

from collections.abc import Sequence
from dataclasses import dataclass

from dic.calibration.calibration import Calibration
from dic.files.lazy import Computed
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.rigidity import correct_rotation
from dic.out_of_plane.tension import correct_tilt, declined
from dic.strain.measurement import Measurement


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

    `measurements`: calibrated measurements with the same reference. `calibration`: calibration of the camera.

    Each correction of the result is computed from the measurement of its image when the correction is used.
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
