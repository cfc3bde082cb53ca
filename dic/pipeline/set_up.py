"""The inputs from which strains and corrections are computed, in addition to the displacement fields."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan, nan
from typing import Any, ClassVar

from dic.calibration.calibration import Calibration
from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError, CorrelationError, require_kind
from dic.out_of_plane.motion import Motion
from dic.pipeline.correction_settings import CorrectionSettings, kinds_of, motion_of
from dic.results.job import Job
from dic.runfile.reader import RunInfo, RunStep
from dic.strain.settings import StrainSettings


@dataclass(frozen=True)
class SeriesSetUp:
    """The inputs that are needed to compute the strains of a series from its displacement fields.

    Attributes
    ----------
    strain : StrainSettings
    motion : Motion or None
        Assumed motion of the specimen, used to correct calibrated strain; None for no correction.
    calibration : Calibration or None
        Calibration of the camera, for results in millimetres.
    calibration_digest : str
        SHA-256 of the calibration's file; "" without a calibration.
    """

    strain: StrainSettings = field(default_factory=lambda: StrainSettings())
    motion: Motion | None = field(default_factory=lambda: Motion())
    calibration: Calibration | None = None
    calibration_digest: str = ""
    reference_s: ClassVar[float] = nan

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON of all values that determine the strains."""
        return {
            "strain": vars(self.strain),
            "motion": None if self.motion is None else self.motion.as_dict(),
            "calibration": self.calibration_digest,
        }

    @classmethod
    def of_job(cls, job: Job, calibration: Calibration | None) -> "SeriesSetUp":
        """Return the set-up with which a result was computed, from its job and its calibration."""
        values = json.loads(job.strains)
        motion = Motion.from_dict(values["motion"])
        return cls(StrainSettings(**values["strain"]), motion, calibration, values["calibration"])

    def motions(self, steps: Mapping[str, Sequence[RunStep]]) -> dict[str, Motion | None]:
        """Return the motion of the specimen in the images of each camera."""
        return dict.fromkeys(steps, self.motion)

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


@dataclass(frozen=True)
class RunSetUp:
    """A run, and the inputs that are needed to compute strains from the run's displacement fields."""

    source: str
    """Path of the run file."""
    info: RunInfo
    settings: CorrelationSettings
    """Settings of the correlation that gave the fields."""
    strain: StrainSettings
    correcting: CorrectionSettings
    """Settings of the corrections, with the values that the run file declares."""
    plate_mm: float
    """Distance of the specimen's surface behind the grid's lines."""
    reference_s: float = nan
    """Time of the reference in the run, with which still images tell a drift; NaN if it is not known."""

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON of all values that determine strain and corrections."""
        correcting = json.loads(self.correcting.as_text())
        known = {} if isnan(self.reference_s) else {"reference_s": self.reference_s}
        return {"strain": vars(self.strain), "correcting": correcting, "plate_mm": self.plate_mm} | known

    def motions(self, steps: Mapping[str, Sequence[RunStep]]) -> dict[str, Motion | None]:
        """Return the motion of the specimen in the images of each camera, from the kinds of their steps."""
        kind = motion_of(kinds_of(step for own in steps.values() for step in own))
        return {camera: self.correcting.motion(kind, camera) for camera in steps}


SetUp = SeriesSetUp | RunSetUp


def strain_of_job(job: Job) -> StrainSettings:
    """Return the strain settings with which the result of a run was computed."""
    return StrainSettings(**json.loads(job.strains)["strain"])


def plate_of_job(job: Job) -> float:
    """Return the distance of the surface behind the grid's lines with which a result was computed, mm."""
    return float(json.loads(job.strains)["plate_mm"])


def reference_time_of_job(job: Job) -> float:
    """Return the time of the reference with which a result was computed, s; NaN if it is not known."""
    return float(json.loads(job.strains).get("reference_s", nan))


def require_calibration(motion: Motion | None, calibration: Calibration | None) -> None:
    """Raise an error if the motion is to be corrected but there is no calibration.

    Raises `CorrelationError` if the motion is not "free", or the shift is stated, and there is no
    calibration, or an argument has the wrong type.
    """
    require_kind("motion", motion, Motion | None, 'give dic.Motion("tension")')
    require_kind("calibration", calibration, Calibration | None, "read it with dic.load_calibration(path)")
    if motion is not None and motion.kind != "free" and calibration is None:
        raise CorrelationError(
            "settings",
            "correct for motion out of the plane",
            "a calibration, which knows the camera's place",
            f"--motion {motion.kind} without one",
            "name a calibration file, such as --calibration cal.h5",
        )
    if motion is not None and motion.shift_std_um is not None and calibration is None:
        raise CorrelationError(
            "settings",
            "state the shift towards the camera",
            "a calibration, with which the shift has an effect",
            "--shift-std-um without one",
            "name a calibration file, such as --calibration cal.h5, or leave out --shift-std-um",
        )


def require_size(calibration: Calibration | None, shape: tuple[int, ...]) -> None:
    """Raise a `CalibrationError` if the calibrated images have another size than `shape`: height, width."""
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
