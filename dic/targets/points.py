"""The class of grid points: the points of a calibration target, on the target and in the image."""

from dataclasses import dataclass, field

import numpy as np

from dic.typing import Float, Indices


@dataclass(frozen=True)
class GridPoints:
    """The points of a calibration target that were found in an image.

    Attributes
    ----------
    index : ndarray of int64, shape (n, 2)
        Column and row of each point on the target, ``0 … lines − 1``. Columns increase with X, rows with Y.
    xy_mm : ndarray, shape (n, 2)
        Coordinates X and Y of each point on the target. The origin is the centre of the target, or the origin
        mark of a plate with three hollow dots.
    uv_px : ndarray, shape (n, 2)
        Coordinates x and y of each point in the image. The x axis points right and the y axis down; the
        centres of pixels have integer coordinates.
    lines : tuple of int
        Number of points along X and along Y. For a line grid these are the numbers of vertical and of
        horizontal lines.
    pitch_mm : float
        Distance between neighbouring points of a row.
    warnings : tuple of str
        Warnings for the user, one sentence each, for example that the axes are ambiguous.
    orientation : str
        Source of the direction of X: ``"mark"`` (a feature of the target), ``"option"`` (an option of the
        user) or ``"assumed"`` (X is the direction closest to the image's right).
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
        """Return grid points whose positions on the target follow from their indices and the pitch.

        The positions are ``xy_mm = (index − (lines − 1)/2)·pitch_mm``.
        """
        xy_mm = (index - (np.array(lines) - 1) / 2) * pitch_mm
        return cls(index, xy_mm, uv_px, lines, pitch_mm, warnings, orientation)

    @property
    def expected(self) -> int:
        """Number of points of the whole target."""
        return self.lines[0] * self.lines[1]

    @property
    def half_mm(self) -> Float:
        """Half widths of the whole target along X and Y, shape (2,)."""
        return (np.array(self.lines) - 1) / 2 * self.pitch_mm

    @property
    def found(self) -> int:
        """Number of points that were found."""
        return len(self.index)

    def outline_px(self) -> Float:
        """Return the image positions of the outermost points, shape (m, 2), px.

        The smallest convex polygon that contains all points on the target is formed. The result is the points
        on the edge of this polygon, in their order along the edge. If the whole target was found, they are
        the points of its outer rows and columns. If the image shows only a part of the target, the polygon
        surrounds this part.
        """
        place = self.index.astype(np.float64)
        corners = np.array(_corners_around(self.index), np.float64)
        following = np.roll(corners, -1, axis=0)
        order: list[int] = []
        for start, end in zip(corners, following, strict=True):
            side = end - start
            away = place - start
            along = away @ side / (side @ side)
            on_side = np.abs(side[0] * away[:, 1] - side[1] * away[:, 0]) < 1e-6 * (1 + side @ side)
            numbers = np.flatnonzero(on_side & (along >= -1e-9) & (along < 1 - 1e-9))
            order += numbers[np.argsort(along[numbers])].tolist()
        outline: Float = self.uv_px[order]
        return outline


def _corners_around(index: Indices) -> list[list[int]]:
    """Return the corners of the convex polygon around places of a lattice, in their order along the edge.

    A. M. Andrew, Information Processing Letters 9 (1979) 216-219: the places are sorted, and one half of the
    edge goes forwards through them, the other one backwards.
    """
    places = sorted(index.tolist())
    corners: list[list[int]] = []
    for half in (places, places[::-1]):
        edge: list[list[int]] = []
        for x, y in half:
            while len(edge) > 1:
                (x0, y0), (x1, y1) = edge[-2:]
                if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                    break
                edge.pop()
            edge.append([x, y])
        corners += edge[:-1]
    return corners
