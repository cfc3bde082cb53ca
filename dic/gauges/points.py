"""Selects the measured points at a gauge's place: in a square, a polygon, or around a point."""

from dataclasses import dataclass

import numpy as np

from dic.gauges.planes import lie_on_one_line, sums_at
from dic.strain.sight import Sight
from dic.typing import Float, Indices, Mask

_DIAGONAL = 1.4143
_NEIGHBOUR = 1.6
"""Points are neighbours, also along diagonals, if their distance is at most this multiple of the spacing."""
_ALONG_X = np.array([1.0, 0.0])
_ROUNDING = 1e-9
"""Points on the edge count as inside: squares are enlarged by this fraction because of rounding errors."""


@dataclass(frozen=True)
class GridPlaces:
    """Reference positions of the measured points, in the unit of a gauge."""

    rows: Indices
    columns: Indices
    """Shape (n,). Row and column indices of the points in the grid of points."""
    position: Float
    """Shape (n, 2). Coordinates of the points, the second upwards."""
    spacing: float
    """Distance between neighbouring points."""
    sight: Sight | None = None
    """Tells which points lie on the same piece of the surface; None if this is not known."""

    @classmethod
    def of(cls, position: Float, use: Mask, sight: Sight | None = None) -> "GridPlaces":
        """Return the places of the points where `use` (rows, columns) is True.

        `position` has the shape (rows, columns, 2). `use` has the shape (rows, columns).
        """
        known = use & np.isfinite(position).all(axis=-1)
        rows, columns = np.nonzero(known)
        apart = [
            np.linalg.norm(np.diff(position, axis=axis), axis=-1)[
                np.take(known, range(1, known.shape[axis]), axis)
                & np.take(known, range(known.shape[axis] - 1), axis)
            ]
            for axis in (0, 1)
        ]
        distances = np.concatenate(apart)
        spacing = float(np.median(distances)) if distances.size else 0.0
        return cls(rows, columns, position[known], spacing, sight)

    def in_square(self, centre: Float, along: Float, width: float) -> Indices:
        """Return the indices of the points in a square with one side parallel to the unit vector `along`."""
        half = 0.5 * width * (1.0 + _ROUNDING)
        x, y = (np.abs(self.position[:, k] - centre[k]) <= _DIAGONAL * half for k in (0, 1))
        near = np.flatnonzero(x & y)
        across = np.array([-along[1], along[0]])
        offset = np.abs((self.position[near] - centre) @ np.column_stack([along, across]))
        return np.asarray(near[(offset <= half).all(axis=1)])

    def in_patch(self, centre: Float, along: Float, width: float) -> Indices:
        """Return the points of `in_square` on the same piece of the surface as the centre.

        If the centre lies outside the region, the point of the patch nearest to the centre replaces it,
        because a patch may extend beyond the edge of the specimen.
        """
        return self._seen(centre, self.in_square(centre, along, width))

    def around(self, place: Float, width: float | None, window_points: int) -> Indices:
        """Return the indices of the points that give displacement and strain at a place of the surface.

        The points lie in a square of the given width. Without a width, the function returns the points of the
        window of local strain around the nearest point. Points beyond a crack or an edge are left out. If the
        place lies outside the region, or has no point near it, the function returns no points.
        """
        reach = 2.0 * self.spacing if width is None else width
        near = self.in_square(place, _ALONG_X, reach)
        if not near.size or (self.sight and not self.sight.contains(self._pixel(self.sight, place, near))):
            return near[:0]
        near = self._seen(place, near)
        if width is not None or not near.size:
            return near
        middle = near[np.argmin(np.linalg.norm(self.position[near] - place, axis=1))]
        apart = np.maximum(np.abs(self.rows - self.rows[middle]), np.abs(self.columns - self.columns[middle]))
        return self._seen(place, np.flatnonzero(apart <= window_points // 2))

    def pieces(self, chosen: Indices) -> int:
        """Return on how many pieces of the surface the points lie; cracks and gaps divide the surface.

        Two points lie on the same piece if a chain of points connects them, and every straight line of the
        chain stays inside the region.
        """
        if self.sight is None or not len(chosen):
            return min(1, len(chosen))
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        pixel, place = self.sight.pixels(self.rows[chosen], self.columns[chosen]), self.position[chosen]
        pairs = cKDTree(place).query_pairs(_NEIGHBOUR * self.spacing, output_type="ndarray")
        pairs = pairs[self.sight.clear(*pixel[pairs.T])]
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=2 * (len(chosen),))
        label = connected_components(links, directed=False)[1]
        # Points of a narrow area may be farther apart than neighbours and yet lie on one piece.
        joined = label == label[0]
        while not joined.all():
            distance, nearest = map(np.asarray, cKDTree(place[joined]).query(place[~joined]))
            order = np.flatnonzero(self.sight.clear(pixel[joined][nearest], pixel[~joined]))
            if not order.size:
                return len(np.unique(label[~joined])) + 1
            best = order[np.argmin(distance[order])]
            joined |= label == label[~joined][best]
        return 1

    def _pixel(self, sight: Sight, place: Float, near: Indices) -> Float:
        """Return the pixel coordinates of a place, from those of the points with indices `near`."""
        pixel, position = sight.pixels(self.rows[near], self.columns[near]), self.position[near]
        if lie_on_one_line(position):
            return np.asarray(pixel[np.argmin(np.linalg.norm(position - place, axis=1))])
        return np.asarray(sums_at(position, place)[0] @ pixel)

    def _seen(self, place: Float, near: Indices) -> Indices:
        """Return the points of `near` to which the straight line from a place stays inside the region."""
        if self.sight is None or not near.size:
            return near
        pixel, start = (
            self.sight.pixels(self.rows[near], self.columns[near]),
            self._pixel(self.sight, place, near),
        )
        if not self.sight.contains(start):
            start = pixel[np.argmin(np.linalg.norm(self.position[near] - place, axis=1))]
        return np.asarray(near[self.sight.clear(start, pixel)])

    def in_polygon(self, corners: Float) -> Indices:
        """Return the indices of the points inside a polygon with the given corners (m, 2), or on its edge."""
        x, y = self.position.T
        inside, on_edge = np.zeros(len(x), np.bool_), np.zeros(len(x), np.bool_)
        tolerance = _ROUNDING * float(np.ptp(corners, axis=0).max())
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            (x0, y0), (x1, y1) = start, end
            crossed = (y0 <= y) != (y1 <= y)
            level = y[crossed]
            inside[crossed] ^= x[crossed] < x0 + (level - y0) / (y1 - y0) * (x1 - x0)
            side = end - start
            share = np.clip((self.position - start) @ side / max(float(side @ side), 1e-300), 0.0, 1.0)
            gap = self.position - start - share[:, None] * side
            on_edge |= (np.abs(gap) <= tolerance).all(axis=1)
        return np.flatnonzero(inside | on_edge)

    def extent(self, unit: str) -> str:
        """Return the range of the measured points' coordinates as text for messages, in the gauge's axes."""
        if not len(self.position):
            return "nothing: there is none"
        x, y = self.position.T * np.array([[1.0], [-1.0 if unit == "px" else 1.0]])
        x_range, y_range = (f"{values.min():.4g} to {values.max():.4g} {unit}" for values in (x, y))
        return f"x from {x_range}, y from {y_range}"
