"""Corrections of strains for out-of-plane motion: by each camera alone, and by two cameras together."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.directions import most_different
from dic.files.lazy import Computed
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correct import Corrections, correct
from dic.out_of_plane.correction import Correction, stated
from dic.out_of_plane.diagnosis import (
    Harmonics,
    Sensitivity,
    contraction_findings,
    rotation_findings,
    tension_findings,
)
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.reference_match import match_references
from dic.out_of_plane.reference_surface import ReferenceSurface
from dic.out_of_plane.tension import with_still
from dic.out_of_plane.two_cameras import TwoCameraStep, correct_with_two_cameras
from dic.pipeline.camera import CorrectedCamera
from dic.pipeline.measured_images import MeasuredImage
from dic.pipeline.still_steps import StillSteps
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain
from dic.typing import Float


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
class MeasuredStep:
    """The images of all cameras at one step of a run, or one image of a series of image files.

    Attributes
    ----------
    number : int
        Index among the steps, from 0; the reference is not counted.
    step : RunStep or None
        None for a series of image files.
    images : dict of str to MeasuredImage
        The image of each camera. The standard deviations of its calibrated strains follow from the best
        correction; its correction is the one by this camera alone.
    means : dict of str to (MeanStrain or None)
        The calibrated mean strain of each image that could be measured.
    joint : TwoCameraStep or None
        The solution for two cameras together.
    provisional : bool
        True if the images of a rotation come again, because their correction needs all images.
    """

    number: int
    step: RunStep | None
    images: dict[str, MeasuredImage]
    means: dict[str, MeanStrain | None]
    joint: TwoCameraStep | None = None
    provisional: bool = False

    @property
    def image(self) -> MeasuredImage:
        """The image of the only camera."""
        (image,) = self.images.values()
        return image

    @property
    def measurements(self) -> dict[str, Measurement]:
        """The measurement of each camera that could measure the step."""
        found = {name: image.measurement for name, image in self.images.items()}
        return {name: measurement for name, measurement in found.items() if measurement is not None}

    def evaluated(self) -> "MeasuredStep":
        """Return this step after the computation of its local strains, which are otherwise computed later."""
        joint, corrections = self.joint, [image.correction for image in self.images.values()]
        if joint is not None and joint.declined is None:
            # The strains of these corrections are written instead of those of each camera alone.
            corrections = list(joint.corrections)
        measured: list[Measurement | Correction] = list(self.measurements.values())
        for each in measured + [found for found in corrections if found is not None and not found.declined]:
            each.strain  # noqa: B018
        return self

    @property
    def outline(self) -> "MeasuredStep":
        """This step without measurements, displacements and local strains, which need most of the memory."""
        images = {
            name: replace(image, measurement=None, correction=image.correction and image.correction.outline())
            for name, image in self.images.items()
        }
        return replace(self, images=images, joint=None if self.joint is None else self.joint.outline())


class Corrector:
    """Correct strains for out-of-plane motion, step by step. Memory does not grow with the number of steps.

    `calibrations`: the calibration of each camera, by the camera's name. `motions`: the specimen's motion, by
    the camera's name; None for no correction. `pair`: two cameras that correct together. `reference_s`: time
    of the reference in a run; NaN if it is not known.
    """

    def __init__(
        self,
        calibrations: Mapping[str, Calibration | None],
        motions: Mapping[str, Motion | None],
        pair: tuple[CorrectedCamera, CorrectedCamera] | None = None,
        reference_s: float = np.nan,
    ) -> None:
        self._calibrations, self._motions = calibrations, motions
        self._still = StillSteps(calibrations, motions, reference_s)
        self._solved: dict[str, Corrections] = {}
        self.pair = None if pair is None else (pair[0].camera, pair[1].camera)
        """Names of the two cameras that are solved together; None if there is no joint solution."""
        self._surface: ReferenceSurface | None = None
        if pair is not None and pair[0].calibration is not None and pair[1].calibration is not None:
            images, both = (pair[0].reference, pair[1].reference), (pair[0].calibration, pair[1].calibration)
            self._surface = match_references(images, both)

    @classmethod
    def of(
        cls,
        cameras: Sequence[CorrectedCamera],
        motions: Mapping[str, Motion | None],
        reference_s: float = np.nan,
    ) -> "Corrector":
        """Return the corrector of cameras; if the motion is a tension, two of them correct together."""
        kinds = {motion and motion.kind for motion in motions.values()}
        pair = _pair(cameras) if kinds == {"tension"} else None
        calibrations = {camera.camera: camera.calibration for camera in cameras}
        return cls(calibrations, motions, pair, reference_s)

    def solve(self, camera: str, measurements: Sequence[Measurement]) -> None:
        """Solve the alignment of a rotation from all images of a camera; each is used several times."""
        calibration, motion = self._calibrations[camera], self._motions[camera]
        if calibration is not None and motion is not None and motion.kind == "rigid":
            self._solved[camera] = correct(measurements, calibration, motion)

    def alignment(self, camera: str) -> Alignment | None:
        """Return the alignment of a rotation: the solved one, otherwise the known one."""
        motion, solved = self._motions[camera], self._solved.get(camera)
        known = None if motion is None else motion.alignment
        return known if solved is None else solved.alignment or known

    def corrected(
        self,
        number: int,
        step: RunStep | None,
        images: Mapping[str, MeasuredImage],
        places: Mapping[str, int],
    ) -> MeasuredStep:
        """Correct the images of a step.

        `images`: the image of each camera, without a correction. `places`: the index of each image among the
        measurements that `solve` was given.
        """
        measured = {
            name: self._still.measured(name, number, step, image, image.measurement)
            for name, image in images.items()
            if image.measurement is not None
        }
        single = {name: self._single(name, measured[name], places.get(name, 0)) for name in measured}
        joint = self._joint(measured)
        found, means = dict(images), {}
        for name, measurement in measured.items():
            correction = single[name]
            best = self._best(name, correction, joint)
            measurement = measurement if best is None else stated(measurement, best)
            own = correction if self._is_known(name) else None
            found[name] = replace(images[name], measurement=measurement, correction=own)
            means[name] = measurement.calibrated_mean
        provisional = need_all_images(self._motions) and not self._solved
        return MeasuredStep(number, step, found, means, joint, provisional)

    def corrections(self, steps: Sequence[MeasuredStep]) -> "RunCorrections":
        """Return the corrections of all steps, with the findings on the set-up.

        `steps`: all steps that `corrected` has returned, or their outlines.
        """
        single, findings, kinds = {}, {}, {motion.kind for motion in self._motions.values() if motion}
        motion = kinds.pop() if len(kinds) == 1 else "free"
        for name, calibration in self._calibrations.items():
            own = [step for step in steps if name in step.means]
            images = [correction for step in own if (correction := step.images[name].correction) is not None]
            solved = self._solved.get(name)
            single[name] = found = Corrections(images, None if solved is None else solved.alignment)
            means, loads_n = [step.means[name] for step in own], _loads_n(own)
            findings[name] = (
                [] if calibration is None else _findings(motion, calibration, means, loads_n, found)
            )
            findings[name] += self._still.findings(name)
        if self.pair is None or self._surface is None:
            return RunCorrections(motion, single, findings)
        of_both = [step for step in steps if step.joint is not None]
        both = {step.step.index: step.joint for step in of_both if step.step is not None and step.joint}
        sentences = tension_findings([found.corrections[0] for found in both.values()], _loads_n(of_both))
        joint = JointCorrections(self.pair, both, [self._surface.text, *sentences])
        return RunCorrections(motion, single, findings, joint)

    def _is_known(self, camera: str) -> bool:
        """Return True if the images of a camera have a correction by now."""
        motion = self._motions[camera]
        return motion is not None and (motion.kind != "rigid" or camera in self._solved)

    def _single(self, camera: str, measurement: Measurement, place: int) -> Correction | None:
        """Return the correction by one camera, or that of an unknown motion as long as none is known."""
        calibration, motion = self._calibrations[camera], self._motions[camera]
        if calibration is None:
            return None
        if camera in self._solved:
            return with_still(self._solved[camera].images[place], measurement, calibration)
        if motion is None or not self._is_known(camera):
            motion = Motion()
        return correct([measurement], calibration, motion).images[0]

    def _joint(self, measurements: Mapping[str, Measurement]) -> TwoCameraStep | None:
        if self.pair is None or any(camera not in measurements for camera in self.pair):
            return None
        first, second = self.pair
        calibrations = self._calibrations[first], self._calibrations[second]
        if calibrations[0] is None or calibrations[1] is None:
            return None
        both = measurements[first], measurements[second]
        return correct_with_two_cameras(both, (calibrations[0], calibrations[1]), self._surface)

    def _best(
        self, camera: str, correction: Correction | None, joint: TwoCameraStep | None
    ) -> Correction | None:
        if joint is None or joint.declined is not None or self.pair is None or camera not in self.pair:
            return correction
        return joint.corrections[self.pair.index(camera)]


def need_all_images(motions: Mapping[str, Motion | None]) -> bool:
    """Return True if corrections need all images together: those of a rotation."""
    return any(motion is not None and motion.kind == "rigid" for motion in motions.values())


def corrected_images(
    images: Sequence[MeasuredImage], calibration: Calibration | None, motion: Motion | None
) -> tuple[Sequence[MeasuredImage], Alignment | None]:
    """Correct the images of one camera; each is corrected when it is used.

    Memory does not grow with the number of images, if `images` are read when they are used.

    Result: the given images with their corrections, and the alignment of the specimen on the rotation stage,
    which is solved from the images if possible, and otherwise is the alignment in `motion`.
    """
    measured = [k for k, image in enumerate(images) if image.measurement is not None]
    places = {k: place for place, k in enumerate(measured)}
    corrector = Corrector({"": calibration}, {"": motion})
    corrector.solve("", Computed(len(measured), lambda place: _measurement(images[measured[place]])))
    found = Computed(
        len(images), lambda k: corrector.corrected(k, None, {"": images[k]}, {"": places.get(k, 0)}).image
    )
    return found, corrector.alignment("")


def corrected_rotation(
    images: Sequence[MeasuredImage], calibration: Calibration, motion: Motion
) -> tuple[Sequence[MeasuredImage], Alignment | None]:
    """Correct all images of a rotation together; see `corrected_images`, which this function calls."""
    return corrected_images(images, calibration, motion)


def _measurement(image: MeasuredImage) -> Measurement:
    if image.measurement is None:
        raise ValueError(f"{image.label} could not be measured")
    return image.measurement


def _loads_n(steps: Iterable[MeasuredStep]) -> Float:
    return np.array([np.nan if step.step is None else step.step.load_n for step in steps])


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
        findings += tension_findings(found.images, loads_n) + contraction_findings(found.images)
    reasons = {c.declined for c in found.images if c.declined is not None}
    return findings + [f"not corrected: {reason}" for reason in sorted(reasons)]


def _pair(cameras: Sequence[CorrectedCamera]) -> tuple[CorrectedCamera, CorrectedCamera] | None:
    """Return the two cameras with the most different directions, the more oblique camera first."""
    by_name = {camera.camera: camera for camera in cameras}
    pair = most_different({name: camera.calibration for name, camera in by_name.items()})
    return None if pair is None else (by_name[pair[0]], by_name[pair[1]])
