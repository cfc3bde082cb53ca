"""The inputs that are needed to compute strains from the displacement fields of a series of images."""

import json
from dataclasses import dataclass, field
from typing import Any

from dic.calibration.calibration import Calibration
from dic.errors import CalibrationError
from dic.out_of_plane.correct import Motion
from dic.pipeline.series_corrections import require_calibration
from dic.results.job import Job
from dic.strain.strain import StrainSettings


@dataclass(frozen=True)
class SeriesSetUp:
    """The inputs that are needed to compute the strains of a series from its displacement fields.

    Attributes
    ----------
    strain : StrainSettings
    motion : Motion
        Assumed motion of the specimen, used to correct calibrated strain.
    calibration : Calibration or None
        Calibration of the camera, for results in millimetres.
    calibration_digest : str
        SHA-256 of the calibration's file; "" without a calibration.
    """

    strain: StrainSettings = field(default_factory=StrainSettings)
    motion: Motion = field(default_factory=Motion)
    calibration: Calibration | None = None
    calibration_digest: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON of all values that determine the strains."""
        return {
            "strain": vars(self.strain),
            "motion": self.motion.as_dict(),
            "calibration": self.calibration_digest,
        }

    @classmethod
    def of_job(cls, job: Job, calibration: Calibration | None) -> "SeriesSetUp":
        """Return the set-up with which a result was computed, from its job and its calibration."""
        values = json.loads(job.strains)
        motion = Motion.from_dict(values["motion"])
        return cls(StrainSettings(**values["strain"]), motion, calibration, values["calibration"])

    def require_use(self, shape: tuple[int, ...]) -> None:
        """Raise an error if images of `shape` (height, width) cannot be measured with this set-up.

        Raises
        ------
        MeasurementError
            If the motion needs a calibration that is missing, or the calibration belongs to images of another
            size.
        """
        require_calibration(self.motion, self.calibration)
        require_size(self.calibration, shape)


def require_size(calibration: Calibration | None, shape: tuple[int, ...]) -> None:
    """Raise an error if the calibration belongs to images of another size than `shape` (height, width).

    Raises
    ------
    CalibrationError
    """
    if calibration is None or calibration.image_shape == shape:
        return
    (height, width), (own_height, own_width) = calibration.image_shape, shape
    raise CalibrationError(
        "reference image",
        "apply calibration",
        f"{width} × {height} px like the grid image",
        f"{own_width} × {own_height} px",
        "calibrate with an image of the same camera and format",
    )
