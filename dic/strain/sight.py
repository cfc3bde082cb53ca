"""Find the neighbours of a point on the same piece of the surface: those that the point "sees".

A crack, a slit or the gap between two bodies separates points that are neighbours on the grid. The relative
displacement of the two points is an opening, not a strain. So a neighbour is used only if the straight line
to it stays inside the region of interest.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.jit import compiled
from dic.image.stored import is_large
from dic.typing import Float, Grey, Indices, Mask

_SAMPLES_PER_PX = 2

_KEPT_BYTES = 16_000_000
"""Greatest size of the windows that are kept for further images; larger ones are found for each image."""

_CACHED = 4
"""Number of regions whose windows are kept for further images."""

Hidden = tuple[Indices, Mask]
"""The result of `Sight.hidden`."""


@dataclass(frozen=True, eq=False)
class Sight:
    """The region of interest, and the coordinates of the grid of points in it."""

    region: Mask
    """Shape (height, width). True for pixels of the region of interest."""
    x_px: Indices
    y_px: Indices
    """Shapes (columns,) and (rows,). Coordinates of the columns and of the rows of points."""
    _kept: dict[int, Hidden] = field(default_factory=dict, init=False, repr=False)

    def __hash__(self) -> int:
        return id(self.region)

    def __eq__(self, other: object) -> bool:
        """Return True if both objects have the same array as region, and equal points."""
        if not isinstance(other, Sight):
            return NotImplemented
        same_points = np.array_equal(self.x_px, other.x_px) and np.array_equal(self.y_px, other.y_px)
        return self.region is other.region and same_points

    def __repr__(self) -> str:
        return f"Sight({len(self.y_px)} × {len(self.x_px)} points)"

    def hidden(self, window: int, rows: slice) -> Hidden:
        """Return what the points see that are so near an edge that they may not see their whole window.

        `window`: width of a window, an odd number of points. `rows`: the rows of the points. The result may
        describe points of other rows as well.

        Returns
        -------
        number : ndarray of int, shape (rows, columns)
            Index of each of these points in `seen`; -1 for a point that sees its whole window. The array has
            no elements if all points of the rows see their whole windows.
        seen : ndarray of bool, shape (n, window, window)
            The result of `neighbours` for each of these points.
        """
        if window in self._kept:
            return self._kept[window]
        if not is_large(self.region.shape):
            # A copy, because the maps of the pixels are not needed for further images.
            maps, everywhere = replace(self), slice(0, len(self.y_px))
            near = maps._near_an_edge(everywhere, window)
            if len(near) * window**2 <= _KEPT_BYTES:
                self._kept.clear()
                self._kept[window] = found = maps._hidden(near, window)
                return found
        return self._hidden(self._near_an_edge(rows, window), window)

    def _near_an_edge(self, rows: slice, window: int) -> Indices:
        """Return row and column, shape (n, 2), of the points near an edge in some rows."""
        some = np.arange(rows.start, rows.stop).repeat(len(self.x_px))
        at = np.stack([some, np.tile(np.arange(len(self.x_px)), rows.stop - rows.start)], axis=-1)
        maps = self._rows_around(some, window // 2) if is_large(self.region.shape) and some.size else self
        return np.asarray(at[~maps._surrounded(at[:, 0], at[:, 1], window // 2)])

    def _hidden(self, near: Indices, window: int) -> Hidden:
        if not len(near):
            return np.empty((0, 0), np.int64), np.empty((0, window, window), np.bool_)
        number: Indices = np.full((len(self.y_px), len(self.x_px)), -1)
        number[near[:, 0], near[:, 1]] = np.arange(len(near))
        return number, self.neighbours(near[:, 0], near[:, 1], window)

    def neighbours(self, rows: Indices, columns: Indices, window: int) -> Mask:
        """Return which points of the windows around given points can be seen from the given points.

        `rows`, `columns`, shape (n,): the given points, each in the middle of its window. `window`: width of
        a window, an odd number of points.

        Result, shape (n, window, window): True for points inside the grid to which the straight line stays
        inside the region.
        """
        if not rows.size:
            return np.empty((0, window, window), np.bool_)
        if is_large(self.region.shape):
            return self._rows_around(rows, window // 2)._neighbours(rows, columns, window)
        return self._neighbours(rows, columns, window)

    def _rows_around(self, rows: Indices, reach: int) -> "Sight":
        """Return the part of a large region in which the windows around some rows of points lie.

        The maps of a whole large region would take several times as much memory as the image.
        """
        # An even number, so that places half-way between two pixels are rounded as in the whole region.
        top = self.y_px[max(0, int(rows.min()) - reach)] // 2 * 2
        bottom = self.y_px[min(len(self.y_px) - 1, int(rows.max()) + reach)]
        return Sight(self.region[top : bottom + 1], self.x_px, self.y_px - top)

    def _neighbours(self, rows: Indices, columns: Indices, window: int) -> Mask:
        reach = window // 2
        seen = np.ones((len(rows), window, window), np.bool_)
        near_an_edge = ~self._surrounded(rows, columns, reach)
        if near_an_edge.any():
            some = np.empty((np.count_nonzero(near_an_edge), window, window), np.bool_)
            at = np.stack([rows[near_an_edge], columns[near_an_edge]], axis=-1)
            see_from(at, self.x_px, self.y_px, self._free_px, some)
            seen[near_an_edge] = some
        return seen

    @cached_property
    def _free_px(self) -> Grey:
        """Distance of each pixel to the next one outside the region, px: the larger one along x and y."""
        import cv2

        return np.asarray(cv2.distanceTransform(self.region.view(np.uint8), cv2.DIST_C, 3), np.float32)

    @cached_property
    def _outside(self) -> NDArray[np.int32]:
        """Number of pixels outside the region above and to the left of each corner of a pixel."""
        import cv2

        return np.asarray(cv2.integral((~self.region).view(np.uint8)), np.int32)

    def _surrounded(self, rows: Indices, columns: Indices, reach: int) -> Mask:
        """Return whether the whole rectangle under each window belongs to the region."""
        outside = self._outside
        top, left = self.y_px[np.maximum(rows - reach, 0)], self.x_px[np.maximum(columns - reach, 0)]
        bottom = self.y_px[np.minimum(rows + reach, len(self.y_px) - 1)] + 1
        right = self.x_px[np.minimum(columns + reach, len(self.x_px) - 1)] + 1
        count = outside[bottom, right] - outside[top, right] - outside[bottom, left] + outside[top, left]
        return np.asarray(count == 0, np.bool_)

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


@lru_cache(maxsize=_CACHED)
def shared_sight(sight: Sight) -> Sight:
    """Return the first object that equals `sight`: all images of a series then share what it has found."""
    return sight


@compiled
def see_from(at: Indices, x_px: Indices, y_px: Indices, free_px: Grey, seen: Mask) -> None:
    """Find which points of the windows around given points can be seen from the given points.

    The places on a line at which the region is looked up are those of `Sight.clear`. If the next pixel
    outside the region is far away, so are all places up to there, which are left out.

    `at`, shape (n, 2): row and column of the given points. `x_px`, `y_px`, shapes (columns,) and (rows,):
    coordinates of the columns and of the rows of points. `free_px`, shape (height, width): distance of each
    pixel to the next one outside the region, the larger one along x and y; 0 outside. `seen`, shape (n,
    window, window): output.
    """
    reach = seen.shape[1] // 2
    for k in range(at.shape[0]):
        x0, y0 = x_px[at[k, 1]], y_px[at[k, 0]]
        for i in range(seen.shape[1]):
            for j in range(seen.shape[2]):
                row, column = at[k, 0] + i - reach, at[k, 1] + j - reach
                clear = 0 <= row < y_px.shape[0] and 0 <= column < x_px.shape[0]
                if clear:
                    dx, dy = x_px[column] - x0, y_px[row] - y0
                    count = _SAMPLES_PER_PX * max(abs(dx), abs(dy))
                    place, step = 0, 1.0 / max(count, 1)
                    while place <= count:
                        share = 1.0 if place == count else place * step
                        free = free_px[round(y0 + share * dy), round(x0 + share * dx)]
                        if free <= 0.0:
                            clear = False
                            break
                        # Between two places, a line advances by half a pixel, and rounding adds one at most.
                        place += max(1, int(_SAMPLES_PER_PX * (free - 1.0)))
                seen[k, i, j] = clear
