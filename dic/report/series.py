"""The mean strains of a run as series over its steps, in µε, camera by camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.camera import Pinhole
from dic.out_of_plane.correction import Correction
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run import RunResult
from dic.report.pair import PairSeries, pair_series
from dic.report.strains import XX, YY, strain_stds, strains
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain
from dic.typing import Float

Kind = Literal["tension", "rotation", ""]

_CLEAR = 3.0
"""Smallest off-axis angle that is shown, in standard deviations of the angle."""
_LEAST_DEG = 1.0
"""Smallest off-axis angle that is shown, in degrees: no camera is aligned better."""

_ALONG_DEG = 15.0
"""Up to this angle between a camera's tilt and an axis, false strain counts as strain along that axis alone;
at this angle 7 % are along the other axis."""


@dataclass(frozen=True)
class CameraSeries:
    """One camera of a run: its direction, and its mean strain at every measured step.

    Attributes
    ----------
    run : int
        Number of the run in the report, from 1.
    on_axis : bool
        Whether this camera is the reference for the others.
    result : CameraResult
        Results of the camera, at k steps.
    corrections : list of Correction
        The k corrections by this camera alone.
    """

    run: int
    on_axis: bool
    result: CameraResult
    corrections: list[Correction]

    @property
    def camera(self) -> str:
        """The camera's name."""
        return self.result.camera

    @property
    def label(self) -> str:
        """The camera's name, with its off-axis angle if the angle is clearly not zero."""
        pinhole = self._leaning
        return self.camera if pinhole is None else f"{self.camera} {pinhole.off_axis_deg:.1f}°"

    @property
    def calibration(self) -> Calibration:
        """The camera's calibration."""
        return self.result.calibration

    @property
    def steps(self) -> list[RunStep]:
        """The k measured steps."""
        return self.result.steps

    @property
    def measurements(self) -> list[Measurement]:
        """The measurements at the steps."""
        return self.result.measurements

    @property
    def angles_deg(self) -> Float:
        """The stage's angle at each step, as read, shape (k,)."""
        return np.array([step.angle_deg for step in self.steps])

    @property
    def off_axis_deg(self) -> float:
        """Angle of the fitted pinhole camera to the grid's normal; 0 if the angle is not known."""
        pinhole = self.calibration.pinhole
        return 0.0 if pinhole is None else pinhole.off_axis_deg

    @property
    def swing(self) -> tuple[int, ...]:
        """Strain components along the camera's tilt; εxx and εyy if the tilt is not along one axis."""
        pinhole = self._leaning
        if pinhole is None:
            return (XX, YY)
        x, y, _ = np.abs(pinhole.centre_mm)
        along = np.tan(np.radians(_ALONG_DEG))
        return (XX,) if y < along * x else (YY,) if x < along * y else (XX, YY)

    @cached_property
    def raw(self) -> Float:
        """Mean strain εxx, εyy, εxy of the displacements in pixels, µε, shape (k, 3); NaN if missing."""
        return strains([m.raw_mean for m in self.measurements])

    @cached_property
    def calibrated(self) -> Float:
        """Mean strain of the calibrated displacements, as `raw`."""
        return strains([m.calibrated_mean for m in self.measurements])

    @cached_property
    def corrected(self) -> Float:
        """Mean strain corrected for out-of-plane motion, as `raw`; NaN where the correction was declined."""
        return strains(self._corrected_means)

    @cached_property
    def corrected_std(self) -> Float:
        """Standard deviations of `corrected`."""
        return strain_stds(self._corrected_means)

    @cached_property
    def declined(self) -> list[str | None]:
        """Reason why a step was not corrected, per step."""
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
    """A run as the report numbers and sorts it.

    Attributes
    ----------
    number : int
        From 1.
    result : RunResult
    kind : str
        "tension", "rotation", or empty if no step could be measured.
    cameras : list of CameraSeries
        The on-axis camera first.
    pair : PairSeries or None
        Joint results of two cameras, if two cameras were used together.
    """

    number: int
    result: RunResult
    kind: Kind
    cameras: list[CameraSeries]
    pair: PairSeries | None = None

    @property
    def steps(self) -> list[RunStep]:
        """Every step that at least one camera measured, in order."""
        steps = {step.index: step for camera in self.cameras for step in camera.steps}
        return [steps[index] for index in sorted(steps)]

    @property
    def on_axis(self) -> CameraSeries | None:
        """The camera with which the others are compared."""
        return next((camera for camera in self.cameras if camera.on_axis), None)

    @property
    def off_axis(self) -> list[CameraSeries]:
        """All other cameras."""
        return [camera for camera in self.cameras if not camera.on_axis]


def number_runs(results: Sequence[RunResult]) -> list[Run]:
    """Number the runs and collect their series.

    The on-axis camera is the camera named ``on_axis``, else the first camera.
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
    """Return strains minus the raw strain of the reference camera, at the steps of both.

    Parameters
    ----------
    of : sequence of RunStep
        The k steps of the strains.
    values : ndarray, shape (k, 3)
        µε.
    reference : CameraSeries

    Returns
    -------
    steps : list of RunStep
    difference : ndarray, shape (len(steps), 3)
        µε.
    """
    rows = {step.index: row for row, step in enumerate(reference.steps)}
    common = [k for k, step in enumerate(of) if step.index in rows]
    other = reference.raw[[rows[of[k].index] for k in common]]
    return [of[k] for k in common], values[common] - other


def _kind(result: RunResult) -> Kind:
    kinds = {step.kind for camera in result.cameras for step in camera.steps}
    if "rotation" in kinds:
        return "rotation"
    return "tension" if kinds & {"load", "displacement"} else ""
