"""Corrections of a run's strains for out-of-plane motion: by each camera alone, and by two together."""

import json
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from dic.calibration.calibration import Calibration
from dic.errors import CorrelationError, require_all
from dic.keywords import named_settings
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
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain
from dic.typing import Float


@named_settings
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
        corrections by one camera. Default: the value in the run file, otherwise the default of `Motion`.
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
        """The assumed uncertainty of the specimen's shift towards the camera."""
        return Shift.of(self.shift_std_um, self.tilt_axis_mm)

    def completed(self, mounting: RunMounting) -> "CorrectionSettings":
        """Return the settings; a setting that is not given has the value that the run file declares."""
        shift_std_um = mounting.shift_std_um if self.shift_std_um is None else self.shift_std_um
        hinge_mm = mounting.tilt_axis_mm if self.tilt_axis_mm is None else self.tilt_axis_mm
        return replace(self, shift_std_um=shift_std_um, tilt_axis_mm=hinge_mm)

    def require_use(self, source: str, cameras: Sequence[str], kinds: Set[str]) -> None:
        """Raise an error if a run with these cameras and kinds of steps cannot use a given setting.

        Call this before `completed`, because a run file of rotations may declare a hinge, which has no
        effect.

        Raises
        ------
        CorrelationError
            If an alignment is given for a camera that the run does not have, or if the run has steps other
            than rotations; or if a hinge is given for a run of rotations.
        """
        if self.tilt_axis_mm is not None and motion_of(kinds) == "rigid":
            expected, remedy = "a run with loaded steps", "leave out --tilt-axis-mm: a rotation has no grips"
            raise CorrelationError(source, "apply the grips' hinge", expected, "rotations alone", remedy)
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
        alignments = {name: alignment.as_lists() for name, alignment in self.alignments.items()}
        content = {"poisson_ratio": self.poisson_ratio, "alignments": alignments}
        content |= {"shift_std_um": self.shift_std_um, "tilt_axis_mm": self.tilt_axis_mm}
        return json.dumps(content)

    @classmethod
    def from_text(cls, text: str) -> "CorrectionSettings":
        """Return the settings from the JSON text that `as_text` returned; older texts have no hinge."""
        content = json.loads(text)
        alignments = {name: Alignment.from_lists(lists) for name, lists in content["alignments"].items()}
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
    steps : mapping of int to TwoCameraStep
        Solution of each step for both cameras together, keyed by the step's number, in the order of the run.
    findings : list of str
        Sentences about the set-up of the test that follow from the corrections.
    """

    cameras: tuple[str, str]
    steps: Mapping[int, TwoCameraStep]
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

        The best correction is the correction by two cameras together, if the step has such a correction.
        Otherwise it is the correction by this camera alone.

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


@dataclass(frozen=True)
class CorrectedStep:
    """The measurements and corrections of one step of a run.

    Attributes
    ----------
    step : RunStep
    measurements : dict of str to Measurement
        The measurement of each camera that could measure the step. The standard deviations of its calibrated
        strains follow from the best correction.
    corrections : dict of str to Correction
        The correction of each of these measurements by this camera alone.
    means : dict of str to (MeanStrain or None)
        The calibrated mean strain of each measurement.
    joint : TwoCameraStep or None
        The solution for two cameras together.
    """

    step: RunStep
    measurements: dict[str, Measurement]
    corrections: dict[str, Correction]
    means: dict[str, MeanStrain | None]
    joint: TwoCameraStep | None = None

    def evaluated(self) -> "CorrectedStep":
        """Return this step after the computation of its local strains, which are otherwise computed later."""
        joint, corrections = self.joint, list(self.corrections.values())
        if joint is not None and joint.declined is None:
            # The strains of these corrections are written instead of those of each camera alone.
            corrections = list(joint.corrections)
        measured: list[Measurement | Correction] = list(self.measurements.values())
        for each in measured + [found for found in corrections if found.declined is None]:
            each.strain  # noqa: B018
        return self

    @property
    def outline(self) -> "CorrectedStep":
        """This step without measurements, displacements and local strains, which need most of the memory."""
        corrections = {name: correction.outline() for name, correction in self.corrections.items()}
        joint = None if self.joint is None else self.joint.outline()
        return replace(self, measurements={}, corrections=corrections, joint=joint)


class RunCorrector:
    """Correct the strains of a run for out-of-plane motion, step by step.

    Memory does not grow with the number of steps, if `CameraResult.measurements` are computed or read when
    they are used.

    Parameters
    ----------
    cameras : sequence of CameraResult
    settings : CorrectionSettings
    """

    def __init__(self, cameras: Sequence[CameraResult], settings: CorrectionSettings) -> None:
        self._cameras = cameras
        self._motion = motion_of({step.kind for camera in cameras for step in camera.steps})
        self._single: dict[str, Corrections] = {}
        for camera in cameras:
            alignment = settings.alignments.get(camera.camera) if self._motion == "rigid" else None
            hinge_mm = None if self._motion == "rigid" else settings.tilt_axis_mm
            known = Motion(self._motion, settings.poisson_ratio, alignment, settings.shift_std_um, hinge_mm)
            self._single[camera.camera] = correct(camera.measurements, camera.calibration, known)
        self._pair = _pair(cameras) if self._motion == "tension" else None
        self._surface = None if self._pair is None else match_references(*self._pair)

    @property
    def pair(self) -> tuple[str, str] | None:
        """Names of the two cameras that are solved together; None if there is no joint solution."""
        return None if self._pair is None else (self._pair[0].camera, self._pair[1].camera)

    def steps(self) -> Iterator[CorrectedStep]:
        """Yield all steps that at least one camera measured, in order."""
        for step, places in measured_steps(self._cameras):
            yield self._step(step, places)

    def corrections(self, steps: Sequence[CorrectedStep]) -> RunCorrections:
        """Return the corrections of all steps, with the findings on the set-up.

        Parameters
        ----------
        steps : sequence of CorrectedStep
            All steps that the method `steps` has yielded, or their outlines.
        """
        single, findings = {}, {}
        for camera in self._cameras:
            name, own = camera.camera, [step for step in steps if camera.camera in step.corrections]
            images = [step.corrections[name] for step in own]
            single[name] = found = Corrections(images, self._single[name].alignment)
            loads_n, means = np.array([step.step.load_n for step in own]), [step.means[name] for step in own]
            findings[name] = _findings(self._motion, camera.calibration, means, loads_n, found)
        if self.pair is None or self._surface is None:
            return RunCorrections(self._motion, single, findings)
        both = {step.step.index: step.joint for step in steps if step.joint is not None}
        loads_n = np.array([step.step.load_n for step in steps if step.joint is not None])
        sentences = tension_findings([found.corrections[0] for found in both.values()], loads_n)
        joint = JointCorrections(self.pair, both, [self._surface.text, *sentences])
        return RunCorrections(self._motion, single, findings, joint)

    def _step(self, step: RunStep, places: Mapping[str, int]) -> CorrectedStep:
        measurements = {
            c.camera: c.measurements[places[c.camera]] for c in self._cameras if c.camera in places
        }
        corrections = {name: self._single[name].images[places[name]] for name in measurements}
        joint = self._joint(measurements)
        measurements = {
            name: stated(measurement, self._best(name, corrections[name], joint))
            for name, measurement in measurements.items()
        }
        means = {name: measurement.calibrated_mean for name, measurement in measurements.items()}
        return CorrectedStep(step, measurements, corrections, means, joint)

    def _joint(self, measurements: Mapping[str, Measurement]) -> TwoCameraStep | None:
        if self._pair is None or any(camera.camera not in measurements for camera in self._pair):
            return None
        first, second = self._pair
        both = measurements[first.camera], measurements[second.camera]
        return correct_with_two_cameras(both, (first.calibration, second.calibration), self._surface)

    def _best(self, camera: str, correction: Correction, joint: TwoCameraStep | None) -> Correction:
        if joint is None or joint.declined is not None or self.pair is None or camera not in self.pair:
            return correction
        return joint.corrections[self.pair.index(camera)]


def measured_steps(cameras: Sequence[CameraResult]) -> Iterator[tuple[RunStep, dict[str, int]]]:
    """Yield each step that a camera measured, with the index of its measurement for each camera, in order."""
    steps = {step.index: step for camera in cameras for step in camera.steps}
    places = {c.camera: {step.index: place for place, step in enumerate(c.steps)} for c in cameras}
    for index, step in sorted(steps.items()):
        yield step, {name: own[index] for name, own in places.items() if index in own}


def correct_run(cameras: Sequence[CameraResult], settings: CorrectionSettings) -> RunCorrections:
    """Correct the strains of all measurements of a run for out-of-plane motion."""
    corrector = RunCorrector(cameras, settings)
    return corrector.corrections(list(corrector.steps()))


def motion_of(kinds: Set[str]) -> str:
    """Return the specimen's motion ("free", "rigid" or "tension") from the kinds of a run's steps."""
    if "rotation" in kinds:
        return "free" if kinds & {"load", "displacement"} else "rigid"
    return "tension" if kinds & {"load", "displacement"} else "free"


def _findings(
    motion: str,
    calibration: Calibration,
    means: Sequence[MeanStrain | None],
    loads_n: Float,
    found: Corrections,
) -> list[str]:
    sensitivity = Sensitivity.of(calibration)
    findings = [] if sensitivity is None else [sensitivity.text]
    if motion == "rigid":
        strains = [[np.nan] * 3 if m is None else [m.exx, m.eyy, m.exy] for m in means]
        angles_deg = np.array([np.nan if m is None else m.rotation_deg for m in means])
        harmonics = Harmonics.of(angles_deg, np.array(strains)) if strains else None
        findings += rotation_findings(harmonics, found.alignment)
    if motion == "tension":
        findings += tension_findings(found.images, loads_n)
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
