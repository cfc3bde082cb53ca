"""Corrections of a run's strains for out-of-plane motion: by each camera alone, and by two together."""

import json
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from dic.errors import CorrelationError, require_all
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correct import (
    POISSON_RATIO,
    Corrections,
    Motion,
    correct,
    poisson_check,
)
from dic.out_of_plane.correction import Correction, stated
from dic.out_of_plane.diagnosis import Harmonics, Sensitivity, rotation_findings, tension_findings
from dic.out_of_plane.shift import Shift, shift_checks
from dic.out_of_plane.two_cameras import TwoCameraStep, correct_with_two_cameras
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.reference_match import match_references
from dic.runfile.mounting import RunMounting


@dataclass(frozen=True)
class CorrectionSettings:
    """Settings of the corrections of a run.

    Attributes
    ----------
    poisson_ratio : float
        Poisson's ratio of the specimen; the correction in tension uses it for the bent shape of the specimen.
    alignments : mapping of str to Alignment
        For rotations: the known alignment of each camera, keyed by the camera's name. An alignment comes from
        an earlier rotation on the same fixture.
    shift_std_um : float, optional
        Standard deviation of the specimen's shift towards the camera since the reference image, for
        corrections by one camera. Default: the value in the run file, otherwise that of `Motion`.
    tilt_axis_mm : tuple of float, optional
        X and Y of the grips' hinge in the grid's axes, for corrections by one camera in tension. Default: the
        hinge in the run file, if it has one.

    Raises
    ------
    CorrelationError
        If Poisson's ratio, the standard deviation of the shift or the hinge is out of range.
    """

    poisson_ratio: float = POISSON_RATIO
    alignments: Mapping[str, Alignment] = field(default_factory=dict)
    shift_std_um: float | None = None
    tilt_axis_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        checks = [poisson_check(self.poisson_ratio), *shift_checks(self.shift_std_um, self.tilt_axis_mm)]
        require_all(CorrelationError, "settings", checks)

    @property
    def shift(self) -> Shift:
        """What is known of the specimen's shift towards the camera."""
        return Shift.of(self.shift_std_um, self.tilt_axis_mm)

    def completed(self, mounting: RunMounting) -> "CorrectionSettings":
        """Return the settings, with the values that a run file declares for those that are not given."""
        shift_std_um = mounting.shift_std_um if self.shift_std_um is None else self.shift_std_um
        hinge_mm = mounting.tilt_axis_mm if self.tilt_axis_mm is None else self.tilt_axis_mm
        return replace(self, shift_std_um=shift_std_um, tilt_axis_mm=hinge_mm)

    def require_use(self, source: str, cameras: Sequence[str], kinds: Set[str]) -> None:
        """Raise an error if a run with these cameras and kinds of steps cannot use the given alignments.

        Raises
        ------
        CorrelationError
            If an alignment is given for a camera that the run does not have, or if the run has steps other
            than rotations.
        """
        unknown = sorted(set(self.alignments) - set(cameras))
        if unknown:
            expected, got, remedy = f"one of {', '.join(cameras)}", unknown[0], "name a camera of the run"
        elif self.alignments and motion_of(kinds) != "rigid":
            expected, got = "a run of rotations alone", f"steps of {', '.join(sorted(kinds))}"
            remedy = "an alignment serves rotations only"
        else:
            return
        raise CorrelationError(source, "apply alignment", expected, got, remedy)

    def as_text(self) -> str:
        """Return the settings as JSON text for the result file."""
        alignments = {
            name: {key: np.asarray(value).tolist() for key, value in vars(alignment).items()}
            for name, alignment in self.alignments.items()
        }
        content = {"poisson_ratio": self.poisson_ratio, "alignments": alignments}
        content |= {"shift_std_um": self.shift_std_um, "tilt_axis_mm": self.tilt_axis_mm}
        return json.dumps(content)

    @classmethod
    def from_text(cls, text: str) -> "CorrectionSettings":
        """Return the settings from the JSON text that `as_text` returned; older texts have no hinge."""
        content = json.loads(text)
        alignments = {
            name: Alignment(**{key: np.array(value, np.float64) for key, value in values.items()})
            for name, values in content["alignments"].items()
        }
        hinge_mm = content.get("tilt_axis_mm")
        return cls(
            float(content["poisson_ratio"]),
            alignments,
            content.get("shift_std_um"),
            None if hinge_mm is None else (hinge_mm[0], hinge_mm[1]),
        )


@dataclass(frozen=True)
class JointCorrections:
    """Corrections that use the images of two cameras together, with one solution for each step.

    Attributes
    ----------
    cameras : tuple of str
        Names of the cameras; the camera with the larger off-axis angle comes first.
    steps : dict of int to TwoCameraStep
        Solution of each step for both cameras together, keyed by the step's number, in the order of the run.
    findings : list of str
        Sentences about the set-up of the test that follow from the corrections.
    """

    cameras: tuple[str, str]
    steps: dict[int, TwoCameraStep]
    findings: list[str]

    def __repr__(self) -> str:
        return f"JointCorrections({' and '.join(self.cameras)}, {len(self.steps)} steps)"


@dataclass(frozen=True)
class RunCorrections:
    """The corrections of a run for motion out of the calibration grid's plane, and findings on the set-up.

    Attributes
    ----------
    motion : str
        Motion of the specimen: "rigid", "tension", or "free" if the kinds of the steps do not determine the
        motion.
    cameras : dict of str to Corrections
        Corrections by each camera alone, keyed by the camera's name, in the order of the camera's
        measurements.
    findings : dict of str to list of str
        Sentences about the set-up of the test, keyed by the camera's name.
    joint : JointCorrections or None
        Corrections by two cameras together. None if the motion is not "tension", or fewer than two cameras
        have a pinhole model.
    """

    motion: str
    cameras: dict[str, Corrections]
    findings: dict[str, list[str]]
    joint: JointCorrections | None = None

    def __repr__(self) -> str:
        return f"RunCorrections({self.motion}, {', '.join(self.cameras)}, {self.joint})"

    def best(self, camera: str, step: int, place: int) -> Correction:
        """Return the best correction of a step.

        The best correction is the correction by two cameras together if the step has one, else the correction
        by this camera alone.

        Parameters
        ----------
        camera : str
        step : int
            Number of the step.
        place : int
            Index of the step in the camera's list of measurements.
        """
        joint = self.joint
        if joint is not None and camera in joint.cameras and step in joint.steps:
            found = joint.steps[step]
            if found.declined is None:
                return found.corrections[joint.cameras.index(camera)]
        return self.cameras[camera].images[place]


def correct_run(cameras: Sequence[CameraResult], settings: CorrectionSettings) -> RunCorrections:
    """Correct the strains of all measurements of a run for out-of-plane motion."""
    motion = motion_of({step.kind for camera in cameras for step in camera.steps})
    corrected, findings = {}, {}
    for camera in cameras:
        alignment = settings.alignments.get(camera.camera) if motion == "rigid" else None
        hinge_mm = None if motion == "rigid" else settings.tilt_axis_mm
        known = Motion(motion, settings.poisson_ratio, alignment, settings.shift_std_um, hinge_mm)
        found = correct(camera.measurements, camera.calibration, known)
        corrected[camera.camera] = found
        findings[camera.camera] = _findings(motion, camera, found)
    pair = _pair(cameras) if motion == "tension" else None
    return RunCorrections(motion, corrected, findings, None if pair is None else _solve_jointly(*pair))


def stated_camera(camera: CameraResult, corrections: RunCorrections) -> CameraResult:
    """Return a camera's results; the errors of its calibrated strains contain the corrections."""
    measurements = [
        stated(measurement, corrections.best(camera.camera, step.index, place))
        for place, (step, measurement) in enumerate(zip(camera.steps, camera.measurements, strict=True))
    ]
    return replace(camera, measurements=measurements)


def motion_of(kinds: Set[str]) -> str:
    """Return the specimen's motion, "free", "rigid" or "tension", from the kinds of a run's steps."""
    if "rotation" in kinds:
        return "free" if kinds & {"load", "displacement"} else "rigid"
    return "tension" if kinds & {"load", "displacement"} else "free"


def _findings(motion: str, camera: CameraResult, found: Corrections) -> list[str]:
    sensitivity = Sensitivity.of(camera.calibration)
    findings = [] if sensitivity is None else [sensitivity.text]
    if motion == "rigid":
        means = [m.calibrated_mean for m in camera.measurements]
        strains = [[np.nan] * 3 if m is None else [m.exx, m.eyy, m.exy] for m in means]
        angles_deg = np.array([np.nan if m is None else m.rotation_deg for m in means])
        harmonics = Harmonics.of(angles_deg, np.array(strains)) if strains else None
        findings += rotation_findings(harmonics, found.alignment)
    if motion == "tension":
        findings += tension_findings(found.images, np.array([step.load_n for step in camera.steps]))
    reasons = {c.declined for c in found.images if c.declined is not None}
    return findings + [f"not corrected: {reason}" for reason in sorted(reasons)]


def _pair(cameras: Sequence[CameraResult]) -> tuple[CameraResult, CameraResult] | None:
    """Return the two cameras with the most different directions, the more oblique camera first."""
    aside = [
        (c.calibration.pinhole.centre_mm[:2] / c.calibration.pinhole.centre_mm[2], c)
        for c in cameras
        if c.calibration.pinhole is not None
    ]
    if len(aside) < 2:
        return None
    # Two cameras measure the height of a point by parallax. The parallax is proportional to the difference of
    # the tangents of their viewing angles.
    pair = max(combinations(aside, 2), key=lambda both: float(np.linalg.norm(both[0][0] - both[1][0])))
    second, first = sorted(pair, key=lambda camera: float(np.linalg.norm(camera[0])))
    return first[1], second[1]


def _solve_jointly(first: CameraResult, second: CameraResult) -> JointCorrections:
    others = {step.index: m for step, m in zip(second.steps, second.measurements, strict=True)}
    calibrations = first.calibration, second.calibration
    surface = match_references(first, second)
    steps, loads_n = {}, []
    for step, measurement in zip(first.steps, first.measurements, strict=True):
        if step.index in others:
            both = measurement, others[step.index]
            steps[step.index] = correct_with_two_cameras(both, calibrations, surface)
            loads_n.append(step.load_n)
    findings = tension_findings([found.corrections[0] for found in steps.values()], np.array(loads_n))
    return JointCorrections((first.camera, second.camera), steps, [surface.text, *findings])
