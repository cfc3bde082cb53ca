"""What two cameras saw together of a run, as series over its steps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.pipeline.run import RunResult
from dic.runfile.reader import RunStep

Float = NDArray[np.float64]

_MICRO = 1e6
_MM_TO_UM = 1e3


@dataclass(frozen=True)
class PairSeries:
    """Two cameras used together: the strain, and the motion of the specimen's plane, at every step both saw.

    Everything is NaN where the correction was declined.

    Attributes
    ----------
    cameras : tuple of str
        The one further aside first; heights are given at its points.
    label : str
    steps : list of RunStep
        The k steps.
    points : list of int
        How many points both saw.
    corrected, corrected_std : ndarray, shape (k, 3)
        Mean strain εxx, εyy, εxy and its standard deviations, µε.
    slopes_deg, slopes_std_deg : ndarray, shape (k, 2)
        Of the specimen's plane along X and Y since the reference.
    shift_um, shift_std_um : ndarray, shape (k,)
        Towards the camera since the reference, at the grid's centre.
    declined : list of (str or None)
    found : list of TwoCameraStep
        What the series were taken from.
    """

    cameras: tuple[str, str]
    label: str
    steps: list[RunStep]
    points: list[int]
    corrected: Float
    corrected_std: Float
    slopes_deg: Float
    slopes_std_deg: Float
    shift_um: Float
    shift_std_um: Float
    declined: list[str | None]
    found: list[TwoCameraStep]


def pair_series(result: RunResult, labels: dict[str, str]) -> PairSeries | None:
    """Return what two cameras of a run saw together, None if no two could be used so.

    Parameters
    ----------
    result : RunResult
    labels : dict of str to str
        What the report calls each camera.
    """
    joint = result.corrections.joint
    if joint is None or not joint.steps:
        return None
    first, second = joint.cameras
    steps = {step.index: step for camera in result.cameras for step in camera.steps}
    indices = sorted(joint.steps)
    found = [joint.steps[index] for index in indices]
    figures = np.array([_figures(step) for step in found])
    return PairSeries(
        (first, second),
        f"{labels[first]} and {labels[second]} together",
        [steps[index] for index in indices],
        [0 if step.mean is None else step.mean.points for step in found],
        figures[:, 0:3],
        figures[:, 3:6],
        figures[:, 6:8],
        figures[:, 8:10],
        figures[:, 10],
        figures[:, 11],
        [step.declined for step in found],
        found,
    )


def _figures(step: TwoCameraStep) -> Float:
    """Return strains and stds, slopes and stds, shift and std of a step, shape (12,)."""
    mean, plane, std = step.mean, step.plane, step.plane_std
    if step.declined is not None or mean is None or plane is None or std is None:
        return np.full(12, np.nan)
    strains = [mean.exx, mean.eyy, mean.exy, mean.exx_std, mean.eyy_std, mean.exy_std]
    slopes_deg = np.degrees([*np.arctan([plane.slope_x, plane.slope_y]), *std[:2]])
    shift = [plane.shift_mm, std[2]]
    return np.concatenate([np.multiply(strains, _MICRO), slopes_deg, np.multiply(shift, _MM_TO_UM)])
