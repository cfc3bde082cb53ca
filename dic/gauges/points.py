"""The points of the measured grid that lie at a gauge's place."""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Indices, Mask

_DIAGONAL = 1.4143
_ROUNDING = 1e-9
"""Points on the edge of a patch count as inside, although rounding may move them by this fraction."""


@dataclass(frozen=True)
class GridPlaces:
    """Reference positions of the measured points, in the unit of a gauge.

    Attributes
    ----------
    rows, columns : ndarray of int, shape (n,)
        Places of the points in the grid of points.
    position : ndarray, shape (n, 2)
        Coordinates of the points, the second upwards.
    spacing : float
        Distance between neighbouring points.
    """

    rows: Indices
    columns: Indices
    position: Float
    spacing: float

    @classmethod
    def of(cls, position: Float, use: Mask) -> "GridPlaces":
        """Return the places of the points where `use` (rows, columns) is True.

        Parameters
        ----------
        position : ndarray, shape (rows, columns, 2)
        use : ndarray of bool, shape (rows, columns)
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
        return cls(rows, columns, position[known], spacing)

    def in_square(self, centre: Float, along: Float, width: float) -> Indices:
        """Return the indices of the points in a square with one side parallel to the unit vector `along`."""
        half = 0.5 * width * (1.0 + _ROUNDING)
        x, y = (np.abs(self.position[:, k] - centre[k]) <= _DIAGONAL * half for k in (0, 1))
        near = np.flatnonzero(x & y)
        across = np.array([-along[1], along[0]])
        offset = np.abs((self.position[near] - centre) @ np.column_stack([along, across]))
        return np.asarray(near[(offset <= half).all(axis=1)])

    def in_polygon(self, corners: Float) -> Indices:
        """Return the indices of the points inside a polygon with the given corners, shape (m, 2)."""
        x, y = self.position.T
        inside = np.zeros(len(x), np.bool_)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            crossed = (y0 <= y) != (y1 <= y)
            level = y[crossed]
            inside[crossed] ^= x[crossed] < x0 + (level - y0) / (y1 - y0) * (x1 - x0)
        return np.flatnonzero(inside)

    def extent(self, unit: str) -> str:
        """Return the range of the measured points as text for messages, in the axes of the unit."""
        if not len(self.position):
            return "nothing: there is none"
        x, y = self.position.T * np.array([[1.0], [-1.0 if unit == "px" else 1.0]])
        x_range, y_range = (f"{values.min():.4g} to {values.max():.4g} {unit}" for values in (x, y))
        return f"x from {x_range}, y from {y_range}"
