"""The cells of the points of a field in a panel, and the cell in which each pixel lies."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.typing import Float, Mask

_REACH = 0.75
"""Largest distance of a pixel from its point, in steps of the grid. A pixel further away lies in a crack that
has opened, beyond which another point would wrongly seem near.
"""
_MOVES = 3
"""Largest number of times that a pixel moves to a neighbouring cell."""

_Places = NDArray[np.float32]


class Cells:
    """Parallelograms around the points of a field.

    `corners`, shape (rows + 1, columns + 1, 2): corners of the cells, px. `known`, shape (rows, columns):
    True for points with a value; the other cells are not used, because on a deformed image they have no
    place.
    """

    def __init__(self, corners: Float, known: Mask) -> None:
        upper, lower = corners[:-1], corners[1:]
        self._centre = (upper[:, :-1] + upper[:, 1:] + lower[:, :-1] + lower[:, 1:]) / 4
        right = (upper[:, 1:] - upper[:, :-1] + lower[:, 1:] - lower[:, :-1]) / 2
        down = (lower[:, :-1] - upper[:, :-1] + lower[:, 1:] - upper[:, 1:]) / 2
        area = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
        self._known = known & (area != 0.0)
        # The inverse of the matrix with the columns `right` and `down` takes px to steps of the grid.
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = np.stack([down[..., 1], -down[..., 0], -right[..., 1], right[..., 0]]) / area
        parts = [*np.moveaxis(self._centre, -1, 0), *steps]
        self._parts = [np.ascontiguousarray(part, np.float32).ravel() for part in parts]
        self._areas = np.abs(area[self._known])

    @property
    def side_px(self) -> float:
        """Distance of neighbouring points; there must be a known point."""
        return float(np.sqrt(np.median(self._areas)))

    def at_pixels(self, size: tuple[int, int]) -> tuple[_Places, _Places, Mask] | None:
        """Return column and row of each pixel among the points, with fractions, and if it is near its point.

        `size`: width and height of the panel. None if no point lies in the panel.
        """
        point = self._nearest(size)
        if point is None:
            return None
        x, y = (np.arange(length, dtype=np.float32) + np.float32(0.5) for length in size)
        columns, rows = self._places(point, x, y[:, None])
        height, width = self._known.shape
        for _ in range(_MOVES):
            # Where cells differ in size, a pixel may lie in the cell beside that of the nearest point.
            row, column = (
                np.rint(at.clip(0, most - 1)).astype(np.int32)
                for at, most in ((rows, height), (columns, width))
            )
            other = row * width + column
            moved = np.nonzero((other != point) & self._known.ravel()[other])
            if not moved[0].size:
                break
            point[moved] = other[moved]
            columns[moved], rows[moved] = self._places(point[moved], x[moved[1]], y[moved[0]])
        away = np.maximum(np.abs(columns - point % width), np.abs(rows - point // width))
        return columns, rows, away <= _REACH

    def _nearest(self, size: tuple[int, int]) -> NDArray[np.int32] | None:
        """Return the index of the nearest known point at each pixel, shape (height, width)."""
        import cv2

        width, height = size
        place = np.floor(self._centre)
        shown = self._known & (place >= 0).all(axis=-1) & (place < (width, height)).all(axis=-1)
        if not shown.any():
            return None
        x, y = place[shown].astype(int).T
        seeds = np.ones((height, width), np.uint8)
        seeds[y, x] = 0
        _, labels = cv2.distanceTransformWithLabels(seeds, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        point = np.zeros(int(labels.max()) + 1, np.int32)
        point[labels[y, x]] = np.flatnonzero(shown)
        return np.asarray(point[labels])

    def _places(self, point: NDArray[np.int32], x: Any, y: Any) -> tuple[_Places, _Places]:
        """Return column and row of pixels at (x, y) px among the points, by the cells of given points."""
        width = self._known.shape[1]
        middle_x, middle_y, column_x, column_y, row_x, row_y = (part[point] for part in self._parts)
        away_x, away_y = x - middle_x, y - middle_y
        columns = column_x * away_x + column_y * away_y + point % width
        rows = row_x * away_x + row_y * away_y + point // width
        return columns.astype(np.float32), rows.astype(np.float32)
