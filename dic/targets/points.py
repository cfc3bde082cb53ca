"""Grid points: the intersections of a line grid, on the grid and in the image."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class GridPoints:
    """The intersections of a calibration grid that were found in an image.

    Attributes
    ----------
    index : ndarray of int64, shape (n, 2)
        Column and row of each intersection on the grid, ``0 … lines − 1``, growing with X and Y.
    xy_mm : ndarray, shape (n, 2)
        Where they are on the grid: X right and Y up as the upright camera sees it, origin at its centre.
    uv_px : ndarray, shape (n, 2)
        Where they are in the image: x right, y down, pixel centres at integers.
    lines : tuple of int
        How many lines the grid has along X and along Y (the number of vertical, then of horizontal lines).
    pitch_mm : float
        Distance of neighbouring lines.
    warnings : tuple of str
        What a user should know, such as axes that could be named otherwise.
    orientation : str
        What says which way X points: ``"mark"``, a mark on the target; ``"option"``, the user; ``"assumed"``,
        by the image's directions.
    """

    index: NDArray[np.int64]
    xy_mm: NDArray[np.float64]
    uv_px: NDArray[np.float64]
    lines: tuple[int, int]
    pitch_mm: float
    warnings: tuple[str, ...] = field(default=())
    orientation: str = "assumed"

    @classmethod
    def on_lattice(
        cls,
        index: NDArray[np.int64],
        uv_px: NDArray[np.float64],
        lines: tuple[int, int],
        pitch_mm: float,
        warnings: tuple[str, ...] = (),
        orientation: str = "assumed",
    ) -> "GridPoints":
        """Return grid points whose millimetres follow from their index: ``(index − (lines − 1)/2)·pitch``."""
        xy_mm = (index - (np.array(lines) - 1) / 2) * pitch_mm
        return cls(index, xy_mm, uv_px, lines, pitch_mm, warnings, orientation)

    @property
    def expected(self) -> int:
        """How many intersections the whole grid has."""
        return self.lines[0] * self.lines[1]

    @property
    def found(self) -> int:
        """How many were found."""
        return len(self.index)

    def outline_px(self) -> NDArray[np.float64]:
        """Return the outermost points that were found, in order around the grid, in px, shape (m, 2)."""
        column, row = self.index[:, 0], self.index[:, 1]
        right, top = self.lines[0] - 1, self.lines[1] - 1
        sides = [
            (row == 0) & (column < right),
            (column == right) & (row < top),
            (row == top) & (column > 0),
            (column == 0) & (row > 0),
        ]
        ways = [column, row, -column, -row]
        order = [np.flatnonzero(side)[np.argsort(way[side])] for side, way in zip(sides, ways, strict=True)]
        outline: NDArray[np.float64] = self.uv_px[np.concatenate(order)]
        return outline
