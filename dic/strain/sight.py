"""Find the neighbours of a point on the same piece of the surface: those that the point "sees".

A crack, a slit or the gap between two bodies separates points that are neighbours on the grid. The relative
displacement of the two points is an opening, not a strain. So a neighbour is used only if the straight line
to it stays inside the region of interest.
"""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Indices, Mask

_SAMPLES_PER_PX = 2


@dataclass(frozen=True)
class Sight:
    """The region of interest, and the coordinates of the grid of points in it.

    Attributes
    ----------
    region : ndarray of bool, shape (height, width)
        True for pixels of the region of interest.
    x_px, y_px : ndarray of int, shapes (columns,) and (rows,)
        Coordinates of the columns and of the rows of points.
    """

    region: Mask
    x_px: Indices
    y_px: Indices

    def __repr__(self) -> str:
        return f"Sight({len(self.y_px)} × {len(self.x_px)} points)"

    def neighbours(self, rows: Indices, columns: Indices, window: int) -> Mask:
        """Return which points of the windows around given points can be seen from the given points.

        Parameters
        ----------
        rows, columns : ndarray of int, shape (n,)
            The given points, each in the middle of its window.
        window : int
            Width of a window, an odd number of points.

        Returns
        -------
        ndarray of bool, shape (n, window, window)
            True for points inside the grid to which the straight line stays inside the region.
        """
        reach = window // 2
        seen = np.ones((len(rows), window, window), np.bool_)
        near_an_edge = ~self._surrounded(rows, columns, reach)
        some = rows[near_an_edge], columns[near_an_edge]
        offsets = np.arange(-reach, reach + 1)
        for i, down in enumerate(offsets):
            for j, right in enumerate(offsets):
                seen[near_an_edge, i, j] = self._sees(*some, int(down), int(right))
        return seen

    def _surrounded(self, rows: Indices, columns: Indices, reach: int) -> Mask:
        """Return whether the whole rectangle under each window belongs to the region."""
        import cv2

        outside = cv2.integral((~self.region).view(np.uint8))
        top, left = self.y_px[np.maximum(rows - reach, 0)], self.x_px[np.maximum(columns - reach, 0)]
        bottom = self.y_px[np.minimum(rows + reach, len(self.y_px) - 1)] + 1
        right = self.x_px[np.minimum(columns + reach, len(self.x_px) - 1)] + 1
        count = outside[bottom, right] - outside[top, right] - outside[bottom, left] + outside[top, left]
        return np.asarray(count == 0, np.bool_)

    def _sees(self, rows: Indices, columns: Indices, down: int, right: int) -> Mask:
        """Return whether each given point sees the point that is `down` rows and `right` columns away."""
        to_row, to_column = rows + down, columns + right
        on_grid = (to_row >= 0) & (to_row < len(self.y_px)) & (to_column >= 0) & (to_column < len(self.x_px))
        to_row, to_column = np.where(on_grid, to_row, rows), np.where(on_grid, to_column, columns)
        return on_grid & self.clear(self.pixels(rows, columns), self.pixels(to_row, to_column))

    def pixels(self, rows: Indices, columns: Indices) -> Float:
        """Return the image coordinates (x, y) of points of the grid, shape (n, 2), px."""
        return np.stack([self.x_px[columns], self.y_px[rows]], axis=-1).astype(np.float64)

    def contains(self, place_px: Float) -> bool:
        """Return whether a place (x, y) in the image belongs to the region."""
        x, y = np.rint(place_px).astype(np.int64)
        height, width = self.region.shape
        return bool(0 <= x < width and 0 <= y < height and self.region[y, x])

    def clear(self, start_px: Float, end_px: Float) -> Mask:
        """Return whether the straight lines between places of the region, shape (n, 2), stay inside it."""
        way = np.asarray(end_px - start_px)
        longest = int(np.ceil(np.abs(way).max(initial=0.0)))
        clear = np.ones(way.shape[:-1], np.bool_)
        for part in np.linspace(0.0, 1.0, _SAMPLES_PER_PX * longest + 1):
            at = np.rint(start_px + part * way).astype(np.int64)
            clear &= self.region[at[..., 1], at[..., 0]]
        return clear
