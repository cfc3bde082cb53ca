"""Classes and functions that compare results of runs with Helm and Deaner's results, as text."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dic.report.numbers import micro, micro_with_std
from dic.report.series import CameraSeries, Run
from dic.report.strains import COMPONENTS
from dic.typing import Float

Figure = Literal[
    "differences",
    "corrected differences",
    "load",
    "raw rotation",
    "calibrated rotation",
    "corrected rotation",
    "residuals",
]


@dataclass(frozen=True)
class Entry:
    """The value of a quantity for one camera of one run, as text."""

    run: int
    camera: str
    ours: str

    @property
    def where(self) -> str:
        """The names of the run and the camera that gave this value."""
        return f"run {self.run}, {self.camera}"


@dataclass(frozen=True)
class PaperComparison:
    """One quantity, with its value in Helm and Deaner's paper and its values in the runs of the report."""

    quantity: str
    """Description of the quantity."""
    paper: str
    """The statement of Helm and Deaner's paper about the quantity, with the paper's numbers."""
    entries: list[Entry]
    """Values of the quantity in the runs."""
    test: str
    """Kind of test: "tension", "rotation" or "calibration"."""
    figure: Figure
    """The report's figure that shows the quantity."""


def turned_cameras(runs: Sequence[Run]) -> list[CameraSeries]:
    """Return the off-axis cameras of all rotation runs, in order of decreasing off-axis angle."""
    turned = [camera for run in runs if run.kind == "rotation" for camera in run.off_axis]
    return sorted(turned, key=lambda camera: camera.off_axis_deg, reverse=True)


def means(values: Float, components: Sequence[int]) -> str:
    """Return the mean of each chosen strain component over the k steps, in µε, as text.

    The strains `values` have the shape (k, 3).
    """
    return ", ".join(f"{COMPONENTS[c]} {micro(_mean(values[:, c]))} µε" for c in components)


def _mean(values: Float) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def worst(values: Float) -> float:
    """Return the largest absolute value of strains, shape (k, 3); NaN if no strain is known."""
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size else float("nan")


def worst_text(camera: CameraSeries, values: Float, stds: Float | None = None) -> str:
    """Return the largest strain of a camera, in µε, and the stage's angle at which it occurs, as text.

    The strains `values` have the shape (k, 3) for k steps; the largest absolute value counts.
    """
    if not np.isfinite(values).any():
        return "–"
    row, component = np.unravel_index(np.nanargmax(np.abs(values)), values.shape)
    value, at = values[row, component], camera.angles_deg[row]
    text = micro(value) if stds is None else micro_with_std(value, stds[row, component])
    return f"{COMPONENTS[component]} {text} µε at {at:.1f}°"
