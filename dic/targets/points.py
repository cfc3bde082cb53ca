"""Grid points: the points of a calibration target, on the target and in the image."""

from dataclasses import dataclass, field

import numpy as np

from dic.typing import Float, Indices


@dataclass(frozen=True)
class GridPoints:
    """The points of a calibration target that were found in an image.

    Attributes
    ----------
    index : ndarray of int64, shape (n, 2)
        Column and row of each point on the target, ``0 … lines − 1``; they increase with X and Y.
    xy_mm : ndarray, shape (n, 2)
        X and Y of each point on the target. The origin is the target's centre.
    uv_px : ndarray, shape (n, 2)
        x and y of each point in the image: x right, y down, pixel centres at integers.
    lines : tuple of int
        Number of points along X and along Y. For a line grid these are the numbers of vertical and of
        horizontal lines.
    pitch_mm : float
        Distance between neighbouring points of a row.
    warnings : tuple of str
        Sentences for the user, such as that the axes are ambiguous.
    orientation : str
        How the direction of X is known: ``"mark"`` (the target shows it), ``"option"`` (the user gave it) or
        ``"assumed"`` (the direction closest to the image's right).
    """

    index: Indices
    xy_mm: Float
    uv_px: Float
    lines: tuple[int, int]
    pitch_mm: float
    warnings: tuple[str, ...] = field(default=())
    orientation: str = "assumed"

    def __repr__(self) -> str:
        found = f"{self.found} of {self.expected} points"
        return f"GridPoints({found}, pitch {self.pitch_mm:g} mm, orientation {self.orientation})"

    @classmethod
    def on_lattice(
        cls,
        index: Indices,
        uv_px: Float,
        lines: tuple[int, int],
        pitch_mm: float,
        warnings: tuple[str, ...] = (),
        orientation: str = "assumed",
    ) -> "GridPoints":
        """Return grid points with ``xy_mm = (index − (lines − 1)/2)·pitch_mm``."""
        xy_mm = (index - (np.array(lines) - 1) / 2) * pitch_mm
        return cls(index, xy_mm, uv_px, lines, pitch_mm, warnings, orientation)

    @property
    def expected(self) -> int:
        """Number of points of the whole target."""
        return self.lines[0] * self.lines[1]

    @property
    def found(self) -> int:
        """Number of points that were found."""
        return len(self.index)

    def outline_px(self) -> Float:
        """Return the points found in the outermost rows and columns, ordered around the rim; (m, 2), px."""
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
        outline: Float = self.uv_px[np.concatenate(order)]
        return outline
