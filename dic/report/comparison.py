"""Types and helpers to compare results with the paper: quantities of each camera and run, as text."""

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
    """The quantity of one camera of one run, as text."""

    run: int
    camera: str
    ours: str

    @property
    def where(self) -> str:
        """Run and camera."""
        return f"run {self.run}, {self.camera}"


@dataclass(frozen=True)
class Comparison:
    """One quantity: its value in the paper and its values in these runs.

    Attributes
    ----------
    quantity : str
    paper : str
        The paper's statement, with the paper's numbers.
    test : str
        "tension", "rotation" or "calibration".
    figure : str
        The report's figure that shows it.
    entries : list of Entry
    """

    quantity: str
    paper: str
    test: str
    figure: Figure
    entries: list[Entry]


def turned_cameras(runs: Sequence[Run]) -> list[CameraSeries]:
    """Return the off-axis cameras of all rotations, in order of decreasing off-axis angle."""
    turned = [camera for run in runs if run.kind == "rotation" for camera in run.off_axis]
    return sorted(turned, key=lambda camera: camera.off_axis_deg, reverse=True)


def means(values: Float, components: Sequence[int]) -> str:
    """Return the means of some components of strains (k, 3) in µε, as text."""
    return ", ".join(f"{COMPONENTS[c]} {micro(_mean(values[:, c]))} µε" for c in components)


def _mean(values: Float) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def worst(values: Float) -> float:
    """Return the largest magnitude of all strains (k, 3); NaN if none is known."""
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size else float("nan")


def worst_text(camera: CameraSeries, values: Float, stds: Float | None = None) -> str:
    """Return the largest of a camera's strains (k, 3) in µε and the stage's angle there, as text."""
    if not np.isfinite(values).any():
        return "–"
    row, component = np.unravel_index(np.nanargmax(np.abs(values)), values.shape)
    value, at = values[row, component], camera.angles_deg[row]
    text = micro(value) if stds is None else micro_with_std(value, stds[row, component])
    return f"{COMPONENTS[component]} {text} µε at {at:.1f}°"
