"""The mean strains of a run as series over its steps, in µε, camera by camera."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dic.out_of_plane.correction import Correction
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run import RunResult
from dic.report.pair import PairSeries, pair_series
from dic.runfile.reader import RunStep
from dic.strain.strain import MeanStrain

Float = NDArray[np.float64]
Kind = Literal["tension", "rotation", ""]

MICRO = 1e6
COMPONENTS = ("εxx", "εyy", "εxy")
XX, YY, XY = range(3)


@dataclass(frozen=True)
class CameraSeries:
    """One camera of a run: where it stands, and its mean strain at every measured step.

    Attributes
    ----------
    run : int
        Number of the run in the report, from 1.
    camera : str
    on_axis : bool
        Whether the others are compared with it.
    off_axis_deg : float or None
        Angle to the grid's normal; None if the rig file does not tell.
    swing : tuple of int
        Components of strain in whose direction the camera leans; εxx and εyy if the rig file does not tell.
    steps : list of RunStep
        The k measured steps.
    raw, calibrated : ndarray, shape (k, 3)
        Mean strain εxx, εyy, εxy in µε; NaN where there is none.
    corrected, corrected_std : ndarray, shape (k, 3)
        The same corrected for motion out of the grid's plane, and its standard deviations; NaN where the
        correction was declined.
    declined : list of (str or None)
        Per step why it was not corrected.
    """

    run: int
    camera: str
    on_axis: bool
    off_axis_deg: float | None
    swing: tuple[int, ...]
    steps: list[RunStep]
    raw: Float
    calibrated: Float
    corrected: Float
    corrected_std: Float
    declined: list[str | None]

    @property
    def label(self) -> str:
        """The camera's name, with its angle where that is known and not zero."""
        return f"{self.camera} {self.off_axis_deg:g}°" if self.off_axis_deg else self.camera

    @property
    def angles_deg(self) -> Float:
        """The stage's angle at each step, as read, shape (k,)."""
        return np.array([step.angle_deg for step in self.steps])


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
    measured : list of CameraResult
        What the series were taken from, in the same order.
    pair : PairSeries or None
        What two cameras saw together, if they were used so.
    """

    number: int
    result: RunResult
    kind: Kind
    cameras: list[CameraSeries]
    measured: list[CameraResult]
    pair: PairSeries | None = None

    @property
    def steps(self) -> list[RunStep]:
        """Every step that at least one camera measured, in order."""
        steps = {step.index: step for camera in self.cameras for step in camera.steps}
        return [steps[index] for index in sorted(steps)]

    @property
    def on_axis(self) -> CameraSeries | None:
        """The camera the others are compared with."""
        return next((camera for camera in self.cameras if camera.on_axis), None)

    @property
    def off_axis(self) -> list[CameraSeries]:
        """All other cameras."""
        return [camera for camera in self.cameras if not camera.on_axis]


def number_runs(results: Sequence[RunResult]) -> list[Run]:
    """Number the runs and collect their series.

    The on-axis camera is the one named ``on_axis``, else the first.
    """
    runs = []
    for number, result in enumerate(results, 1):
        names = [camera.camera for camera in result.cameras]
        on_axis = "on_axis" if "on_axis" in names else next(iter(names), "")
        first = sorted(result.cameras, key=lambda camera: camera.camera != on_axis)
        cameras = [_series(number, result, camera, camera.camera == on_axis) for camera in first]
        labels = {camera.camera: camera.label for camera in cameras}
        pair = pair_series(result, labels)
        runs.append(Run(number, result, _kind(result), cameras, first, pair))
    return runs


def difference(of: Sequence[RunStep], values: Float, reference: CameraSeries) -> tuple[list[RunStep], Float]:
    """Return strains minus the raw strain of the reference camera, at the steps both have.

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


def _series(number: int, result: RunResult, camera: CameraResult, on_axis: bool) -> CameraSeries:
    pan_deg, tilt_deg = _lean(result.info.configuration, camera.camera)
    angle: float | None = None
    swing: tuple[int, ...] = (XX, YY)
    if pan_deg is not None and tilt_deg is not None:
        angle = math.degrees(math.acos(math.cos(math.radians(pan_deg)) * math.cos(math.radians(tilt_deg))))
        angle = round(angle, 3)
        swing = (XX,) if not tilt_deg else (YY,) if not pan_deg else (XX, YY)
    raw = _micro([m.raw_mean for m in camera.measurements])
    calibrated = _micro([m.calibrated_mean for m in camera.measurements])
    images = result.corrections.cameras[camera.camera].images
    corrected, corrected_std = _corrected(images)
    return CameraSeries(
        number,
        camera.camera,
        on_axis,
        angle,
        swing,
        camera.steps,
        raw,
        calibrated,
        corrected,
        corrected_std,
        [correction.declined for correction in images],
    )


def _corrected(images: Sequence[Correction]) -> tuple[Float, Float]:
    means = [None if image.declined is not None else image.mean for image in images]
    stds = [(np.nan,) * 3 if m is None else (m.exx_std, m.eyy_std, m.exy_std) for m in means]
    return _micro(means), np.array(stds, np.float64).reshape(-1, 3) * MICRO


def _micro(means: Sequence[MeanStrain | None]) -> Float:
    rows = [(np.nan,) * 3 if mean is None else (mean.exx, mean.eyy, mean.exy) for mean in means]
    return np.array(rows, np.float64).reshape(-1, 3) * MICRO


def _kind(result: RunResult) -> Kind:
    kinds = {step.kind for camera in result.cameras for step in camera.steps}
    if "rotation" in kinds:
        return "rotation"
    return "tension" if kinds & {"load", "displacement"} else ""


def _lean(configuration: str, camera: str) -> tuple[float | None, float | None]:
    """Return pan and tilt of a camera as the rig file gives them; (None, None) if it gives neither."""
    try:
        table: Any = tomllib.loads(configuration).get("cameras", {}).get(camera, {})
    except (tomllib.TOMLDecodeError, AttributeError):
        return None, None
    if not isinstance(table, dict) or not {"pan_deg", "tilt_deg"} & set(table):
        return None, None
    pan, tilt = table.get("pan_deg", 0.0), table.get("tilt_deg", 0.0)
    return (float(pan), float(tilt)) if all(isinstance(v, int | float) for v in (pan, tilt)) else (None, None)
