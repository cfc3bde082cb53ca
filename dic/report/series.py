"""The mean strains of each camera of a run as arrays over the steps, in µε."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.camera import Pinhole
from dic.out_of_plane.correction import Correction
from dic.pipeline.correction_settings import kinds_of
from dic.pipeline.result import CameraResult, RunResult
from dic.report.pair import PairSeries, pair_series
from dic.report.strains import XX, YY, strain_stds, strains
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain
from dic.typing import Float

Kind = Literal["tension", "rotation", ""]

_CLEAR = 3.0
"""The report shows an off-axis angle only if it exceeds its standard deviation by this factor."""
_LEAST_DEG = 1.0
"""The report shows no smaller off-axis angle: it is within the usual error of alignment."""

LONG = 100
"""Of a run with more steps, the report shows curves over time, and a part of the rows and images."""

_ALONG_DEG = 15.0
"""Largest angle between a camera's tilt and an axis for which false strain counts as strain along the axis.

At this angle, 7 % of the false strain is along the other axis.
"""


@dataclass(frozen=True)
class ImageOutline:
    """What the report needs of each image of a camera: small values, which are read once."""

    raw: MeanStrain
    calibrated: MeanStrain | None
    calibrated_is_known: bool
    """True if the standard deviations of `calibrated` have all their parts."""
    start: str
    """Where the first guess of the correlation came from."""
    objection: str | None
    """The reason why the measurement is not good; None if it is good."""

    @classmethod
    def of(cls, measurement: Measurement) -> "ImageOutline":
        """Return the outline of a measurement."""
        known = measurement.by_images is not None
        start, objection = measurement.field.start, measurement.objection
        return cls(measurement.raw_mean, measurement.calibrated_mean, known, start, objection)


@dataclass(frozen=True)
class CameraSeries:
    """The results of one camera of a run: its off-axis angle, and its mean strain at every measured step."""

    run: int
    """Number of the run in the report, from 1."""
    on_axis: bool
    """True if the other cameras are compared with this camera."""
    result: CameraResult
    """Results of the camera at k steps."""
    stored: Sequence[Correction]
    """Corrections of the k steps by this camera alone; those of a file are read when they are used."""

    @property
    def camera(self) -> str:
        """The camera's name."""
        return self.result.camera

    @property
    def label(self) -> str:
        """The camera's name, followed by its off-axis angle if this angle is clearly not zero."""
        pinhole = self._leaning
        return self.camera if pinhole is None else f"{self.camera} {pinhole.off_axis_deg:.1f}°"

    @property
    def calibration(self) -> Calibration:
        """The camera's calibration."""
        return self.result.require_calibration()

    @property
    def steps(self) -> list[RunStep]:
        """The k steps that the camera could measure."""
        return self.result.steps

    @property
    def measurements(self) -> Sequence[Measurement]:
        """The camera's measurements at the k steps."""
        return self.result.measurements

    @property
    def angles_deg(self) -> Float:
        """The angle that the rotation stage reported at each step, degrees, shape (k,)."""
        return np.array([step.angle_deg for step in self.steps])

    @property
    def off_axis_deg(self) -> float:
        """Angle between the grid's normal and the direction to the camera; 0 if the angle is not known."""
        pinhole = self.calibration.pinhole
        return 0.0 if pinhole is None else pinhole.off_axis_deg

    @property
    def swing(self) -> tuple[int, ...]:
        """Indices of the strain components in the direction of the camera's tilt.

        If the direction of the camera's tilt is not close to X or to Y, both εxx and εyy are given.
        """
        pinhole = self._leaning
        if pinhole is None:
            return (XX, YY)
        x, y, _ = np.abs(pinhole.centre_mm)
        along = np.tan(np.radians(_ALONG_DEG))
        return (XX,) if y < along * x else (YY,) if x < along * y else (XX, YY)

    @cached_property
    def outlines(self) -> list[ImageOutline]:
        """The outlines of the k measurements."""
        return [ImageOutline.of(measurement) for measurement in self.measurements]

    @cached_property
    def corrections(self) -> list[Correction]:
        """The corrections of the k steps without displacements and local strains."""
        return [correction.outline() for correction in self.stored]

    @cached_property
    def raw(self) -> Float:
        """Mean strain εxx, εyy, εxy from displacements in pixels, µε, shape (k, 3); NaN if not known."""
        return strains([image.raw for image in self.outlines])

    @cached_property
    def calibrated(self) -> Float:
        """Mean strain εxx, εyy, εxy from calibrated displacements, µε, shape (k, 3); NaN if not known."""
        return strains([image.calibrated for image in self.outlines])

    @cached_property
    def calibrated_std(self) -> Float:
        """Standard deviations of the calibrated mean strain, µε, shape (k, 3); NaN if not known.

        Result files of earlier versions contain only the part that the images cause, which is a small part of
        the error.
        """
        return strain_stds([each.calibrated if each.calibrated_is_known else None for each in self.outlines])

    @cached_property
    def corrected(self) -> Float:
        """Mean strain εxx, εyy, εxy corrected for out-of-plane motion, µε, shape (k, 3).

        The strain is NaN for a step that was not corrected.
        """
        return strains(self._corrected_means)

    @cached_property
    def corrected_std(self) -> Float:
        """Standard deviations of the corrected mean strain, µε, shape (k, 3)."""
        return strain_stds(self._corrected_means)

    @cached_property
    def declined(self) -> list[str | None]:
        """The reason, for each step, why the step was not corrected; None for a corrected step."""
        return [correction.declined for correction in self.corrections]

    @property
    def _corrected_means(self) -> list[MeanStrain | None]:
        return [None if c.declined is not None else c.mean for c in self.corrections]

    @property
    def _leaning(self) -> Pinhole | None:
        pinhole = self.calibration.pinhole
        if pinhole is None or pinhole.off_axis_deg < max(_LEAST_DEG, _CLEAR * pinhole.off_axis_std_deg):
            return None
        return pinhole


@dataclass(frozen=True)
class Run:
    """A run in the report, with its number and its cameras."""

    number: int
    """Number of the run in the report, from 1."""
    result: RunResult
    kind: Kind
    """Kind of test: "tension", "rotation", or empty if no step could be measured."""
    cameras: list[CameraSeries]
    """Results of the cameras; the on-axis camera is the first."""
    pair: PairSeries | None = None
    """The results that two cameras of the run give together; None if the run has no such results."""

    @property
    def is_long(self) -> bool:
        """True if the report shows only a part of the steps in tables and maps."""
        return len(self.steps) > LONG

    @cached_property
    def steps(self) -> list[RunStep]:
        """All steps that at least one camera could measure, in order."""
        steps = {step.index: step for camera in self.cameras for step in camera.steps}
        return [steps[index] for index in sorted(steps)]

    @property
    def on_axis(self) -> CameraSeries | None:
        """The camera with which the other cameras are compared; None if the run has no camera."""
        return next((camera for camera in self.cameras if camera.on_axis), None)

    @property
    def off_axis(self) -> list[CameraSeries]:
        """All cameras except the on-axis camera."""
        return [camera for camera in self.cameras if not camera.on_axis]


def number_runs(results: Sequence[RunResult]) -> list[Run]:
    """Number the runs of the report, and collect the results of the cameras of each run.

    The on-axis camera of a run is the camera named ``on_axis``, or the first camera if no camera has this
    name.
    """
    runs = []
    for number, result in enumerate(results, 1):
        names = [camera.camera for camera in result.cameras]
        on_axis = "on_axis" if "on_axis" in names else next(iter(names), "")
        cameras = [
            CameraSeries(number, c.camera == on_axis, c, result.corrections.cameras[c.camera].images)
            for c in sorted(result.cameras, key=lambda camera: camera.camera != on_axis)
        ]
        pair = pair_series(result, {camera.camera: camera.label for camera in cameras})
        runs.append(Run(number, result, _kind(result), cameras, pair))
    return runs


def difference(of: Sequence[RunStep], values: Float, reference: CameraSeries) -> tuple[list[RunStep], Float]:
    """Return the difference between given strains and the raw strain of a reference camera.

    `of`: the k steps to which the strains belong. `values`, shape (k, 3): the strains, µε. `reference`: the
    camera whose raw strain is subtracted.

    Returns
    -------
    steps : list of RunStep
        The steps for which the given strain and the strain of the reference camera exist.
    difference : ndarray, shape (len(steps), 3)
        Differences of the strains, µε.
    """
    rows = {step.index: row for row, step in enumerate(reference.steps)}
    common = [k for k, step in enumerate(of) if step.index in rows]
    other = reference.raw[[rows[of[k].index] for k in common]]
    return [of[k] for k in common], values[common] - other


def _kind(result: RunResult) -> Kind:
    kinds = kinds_of(step for camera in result.cameras for step in camera.steps)
    if "rotation" in kinds:
        return "rotation"
    return "tension" if kinds & {"load", "displacement"} else ""
