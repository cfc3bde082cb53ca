"""The joint results of two cameras of a run, as series over its steps."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dic.out_of_plane.correction import Correction
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.pipeline.run import RunResult
from dic.report.strains import plane_slopes, strain_stds, strains
from dic.runfile.reader import RunStep
from dic.typing import Float

_MM_TO_UM = 1e3


@dataclass(frozen=True)
class PairSeries:
    """Two cameras used together: strain and motion of the specimen's plane, step by step.

    Attributes
    ----------
    cameras : tuple of str
        Names of the cameras, the more oblique camera first; heights are given at its points.
    label : str
    steps : list of RunStep
        The k steps.
    found : list of TwoCameraStep
        The joint solution of each.
    """

    cameras: tuple[str, str]
    label: str
    steps: list[RunStep]
    found: list[TwoCameraStep]

    @cached_property
    def points(self) -> list[int]:
        """Number of points that both cameras share, per step."""
        return [0 if step.mean is None else step.mean.points for step in self.found]

    @cached_property
    def corrected(self) -> Float:
        """Mean strain εxx, εyy, εxy, µε, shape (k, 3); NaN where the correction was declined."""
        return strains([step.mean for step in self.found])

    @cached_property
    def corrected_std(self) -> Float:
        """Standard deviations of `corrected`."""
        return strain_stds([step.mean for step in self.found])

    @cached_property
    def slopes_deg(self) -> Float:
        """Slopes of the specimen's plane along X and Y since the reference, shape (k, 2)."""
        return plane_slopes(self._planes)[0]

    @cached_property
    def slopes_std_deg(self) -> Float:
        """Standard deviations of `slopes_deg`."""
        return plane_slopes(self._planes)[1]

    @cached_property
    def shift_um(self) -> Float:
        """Shift of the plane towards the camera since the reference, at the grid's centre, shape (k,)."""
        planes = [None if step.declined is not None else step.plane for step in self.found]
        return _MM_TO_UM * np.array([np.nan if plane is None else plane.shift_mm for plane in planes])

    @cached_property
    def shift_std_um(self) -> Float:
        """Standard deviations of `shift_um`."""
        stds = [None if step.declined is not None else step.plane_std for step in self.found]
        return _MM_TO_UM * np.array([np.nan if std is None else std[2] for std in stds])

    @cached_property
    def declined(self) -> list[str | None]:
        """Reason why a step was not corrected, per step."""
        return [step.declined for step in self.found]

    @property
    def _planes(self) -> list[Correction]:
        return [step.corrections[0] for step in self.found]


def pair_series(result: RunResult, labels: dict[str, str]) -> PairSeries | None:
    """Return the joint results of two cameras of a run; None if no two could be used together.

    Parameters
    ----------
    result : RunResult
    labels : dict of str to str
        Name of each camera in the report.
    """
    joint = result.corrections.joint
    if joint is None or not joint.steps:
        return None
    first, second = joint.cameras
    steps = {step.index: step for camera in result.cameras for step in camera.steps}
    indices = sorted(joint.steps)
    return PairSeries(
        joint.cameras,
        f"{labels[first]} and {labels[second]} together",
        [steps[index] for index in indices],
        [joint.steps[index] for index in indices],
    )
