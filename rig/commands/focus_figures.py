"""The figures of an image that take longer than a frame: the speckles, and the residual of the grid."""

from dataclasses import asdict, dataclass, field
from typing import Any

import cv2
import numpy as np

from dic.errors import MeasurementError
from dic.targets import Target
from rig.commands.check import Image, judge
from rig.protocol.grid import AnyGrid

MIDDLE_PX = 512
"""Side of the square in the middle of the image whose speckles are judged: half a second of computing."""
GRID_PX = 1024
"""A larger image is made smaller than this to find the grid, which then takes a second and not ten."""


@dataclass(frozen=True)
class GridNow:
    """The grid in an image: number of points, and the residual of the bicubic map in px of the image."""

    points: int
    rms_px: float
    max_px: float


@dataclass(frozen=True)
class SlowFigures:
    """Speckles and grid of one image.

    Attributes
    ----------
    taken_s : float
        When the image was taken, on the computer's clock.
    quality : dict of str to any
        The figures of `dic quality`; empty for an image of the grid.
    in_middle : bool
        True if they are those of the middle of the image only.
    findings : list of str
        A sentence for each figure that is not good.
    grid : GridNow or None
    no_grid : str
        Why no grid was found; empty if it was found or not looked for.
    """

    taken_s: float
    quality: dict[str, Any] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    grid: GridNow | None = None
    no_grid: str = ""
    in_middle: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as a table for JSON."""
        return {name: value for name, value in asdict(self).items() if name != "taken_s"}


def target_of(grid: AnyGrid) -> Target:
    """Return the calibration target that the table `[grid]` of a protocol describes."""
    from dic.targets import TARGETS

    return TARGETS[grid.target].of(grid.counts, dict(grid))


def slow_figures(image: Image, bits: int, target: Target | None, taken_s: float) -> SlowFigures:
    """Look for the grid, if a target is given, and judge the speckles if there is no grid."""
    no_grid = ""
    if target is not None:
        found = find_grid(image, target)
        if isinstance(found, GridNow):
            return SlowFigures(taken_s, grid=found)
        no_grid = found
    middle = middle_of(image)
    quality, findings = judge(middle, bits)
    return SlowFigures(taken_s, quality, findings, None, no_grid, middle.size < image.size)


def middle_of(image: Image) -> Image:
    """Return the square in the middle of an image, at most `MIDDLE_PX` wide and high."""
    rows, columns = (slice(max(0, (side - MIDDLE_PX) // 2), (side + MIDDLE_PX) // 2) for side in image.shape)
    return image[rows, columns]


def find_grid(image: Image, target: Target) -> GridNow | str:
    """Return the grid in an image, or the reason why it is not found."""
    from dic.calibration import BicubicMap, Residuals
    from dic.targets import find_target

    factor = -(-max(image.shape) // GRID_PX)
    height, width = (side // factor for side in image.shape)
    part = image[: height * factor, : width * factor]
    small = part if factor == 1 else cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
    try:
        grid = find_target(small.astype(np.float32), target, "image")
        residuals = Residuals.of(BicubicMap.fit(grid.uv_px, grid.xy_mm), grid)
    except MeasurementError as error:
        return str(getattr(error, "got", "") or error)
    return GridNow(len(grid.uv_px), factor * residuals.rms_px, factor * residuals.max_px)
