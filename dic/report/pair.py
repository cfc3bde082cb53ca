"""The results that two cameras of a run give together, as arrays with a row for each step."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dic.out_of_plane.correction import Correction
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.pipeline.result import RunResult
from dic.report.strains import plane_slopes, strain_stds, strains
from dic.runfile.reader import RunStep
from dic.typing import Float

_MM_TO_UM = 1e3


@dataclass(frozen=True)
class PairSeries:
    """The results that two cameras give together: strain and motion of the specimen's plane at each step."""

    cameras: tuple[str, str]
    """Names of the cameras. The first camera looks more obliquely, and heights are given at its points."""
    label: str
    """Name of the two cameras in the report."""
    steps: list[RunStep]
    """The k steps that both cameras measured."""
    found: list[TwoCameraStep]
    """The solution of each step for both cameras together, without fields of points."""

    @cached_property
    def points(self) -> list[int]:
        """Number of points, at each step, that both cameras see; 0 for a step that was not corrected."""
        return [0 if step.mean is None else step.mean.points for step in self.found]

    @cached_property
    def corrected(self) -> Float:
        """Corrected mean strain εxx, εyy, εxy, µε, shape (k, 3); NaN for a step that was not corrected."""
        return strains([step.mean for step in self.found])

    @cached_property
    def corrected_std(self) -> Float:
        """Standard deviations of the corrected mean strain, µε, shape (k, 3)."""
        return strain_stds([step.mean for step in self.found])

    @cached_property
    def slopes_deg(self) -> Float:
        """Tilt of the specimen's plane along X and Y since the reference step, degrees, shape (k, 2)."""
        return plane_slopes(self._planes)[0]

    @cached_property
    def slopes_std_deg(self) -> Float:
        """Standard deviations of the slopes in `slopes_deg`, shape (k, 2)."""
        return plane_slopes(self._planes)[1]

    @cached_property
    def shift_um(self) -> Float:
        """Shift of the specimen's plane towards the cameras since the reference step, µm, shape (k,).

        The shift is measured at the centre of the calibration grid.
        """
        planes = [None if step.declined is not None else step.plane for step in self.found]
        return _MM_TO_UM * np.array([np.nan if plane is None else plane.shift_mm for plane in planes])

    @cached_property
    def shift_std_um(self) -> Float:
        """Standard deviations of the shift in `shift_um`, shape (k,)."""
        stds = [None if step.declined is not None else step.plane_std for step in self.found]
        return _MM_TO_UM * np.array([np.nan if std is None else std[2] for std in stds])

    @cached_property
    def declined(self) -> list[str | None]:
        """The reason, for each step, why the step was not corrected; None for a corrected step."""
        return [step.declined for step in self.found]

    @property
    def _planes(self) -> list[Correction]:
        return [step.corrections[0] for step in self.found]


def pair_series(result: RunResult, labels: dict[str, str]) -> PairSeries | None:
    """Return the results that two cameras of a run give together; None if the run has no such results.

    `labels`: name of each camera in the report, keyed by the camera's name in the run.
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
        [joint.steps[index].outline() for index in indices],
    )
