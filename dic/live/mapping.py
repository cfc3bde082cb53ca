"""A calibration's map at a few points that move slowly: an expansion about their last places, and its area.

The exact map of a pinhole camera with a distorting lens takes longer than the correlation of a gauge. Within
a few px it is a quadratic function of the place. With a focal length of 1000 px, the third-order terms that
are left out stay below 2e-5 px, and they are nearly the same at all points of a gauge.
"""

import numpy as np

from dic.calibration.calibration import Calibration
from dic.typing import Float, Mask

_REACH_PX = 4.0
"""The map is expanded anew about points that have moved farther from the places of the last expansion."""

_STEP_PX = 0.5
"""Step of the numerical second derivatives."""


class LocalMap:
    """The map of a calibration at n points, shape (n, 2), that move slowly; `px`: their first places."""

    def __init__(self, calibration: Calibration, px: Float) -> None:
        self.calibration = calibration
        self._about(px)

    def at(self, px: Float) -> tuple[Float, Float]:
        """Return the places (n, 2), mm, and the derivatives (n, 2, 2), mm/px, at image points (n, 2)."""
        off = px - self._px
        if not np.abs(off).max() <= _REACH_PX:
            self._about(px)
            return self._mm, self._first
        by_second = (self._second @ off[:, None, :, None])[..., 0]
        jacobian = self._first + by_second
        # The mean of both derivatives is that of the quadratic function half-way.
        mm = self._mm + ((jacobian - 0.5 * by_second) @ off[:, :, None])[..., 0]
        return mm, jacobian

    def _about(self, px: Float) -> None:
        """Expand the map about these places."""
        right, down = _STEP_PX * np.eye(2)
        both = np.concatenate([px, px + right, px - right, px + down, px - down])
        mm, jacobian = self.calibration.map_and_jacobian(both)
        self._px, self._mm, self._first = px.copy(), mm[: len(px)], jacobian[: len(px)]
        ahead_x, behind_x, ahead_y, behind_y = np.split(jacobian[len(px) :], 4)
        # Element [n, i, j, k] is the derivative of the Jacobian's element [i, j] along axis k.
        self._second = np.stack([ahead_x - behind_x, ahead_y - behind_y], axis=-1) / (2 * _STEP_PX)


class CalibratedArea:
    """Tells which of a few points that move slowly lie inside the calibrated area."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        corners = calibration.outline_px
        self._start, self._side = corners, np.roll(corners, -1, axis=0) - corners
        self._px: Float | None = None
        self._inside: Mask = np.zeros(0, np.bool_)
        self._clear_px = 0.0

    def inside(self, px: Float) -> Mask:
        """Return True for image points (n, 2) in the calibrated area."""
        last = self._px
        if last is None or not np.abs(px - last).max() < self._clear_px:
            self._px, self._inside = px.copy(), self._calibration.inside(px)
            # Points that move by less than this along both axes cannot cross the outline.
            self._clear_px = float(self._distances(px).min()) / np.sqrt(2.0)
        return self._inside

    def _distances(self, px: Float) -> Float:
        """Return the distance of each point (n, 2) from the outline, px."""
        off = px[:, None, :] - self._start
        lengths = np.maximum((self._side**2).sum(axis=1), 1e-12)
        share = np.clip((off * self._side).sum(axis=2) / lengths, 0.0, 1.0)
        apart = np.linalg.norm(off - share[..., None] * self._side, axis=2)
        return np.asarray(np.nan_to_num(apart.min(axis=1), nan=0.0))
