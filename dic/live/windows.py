"""The part of a frame that shows the points of each tile: it follows the points from frame to frame."""

import numpy as np

from dic.correlation.kernel import Part
from dic.correlation.kernel.warps import EDGE_PX
from dic.typing import Float, Indices

_SECOND = np.array([0.5, 1.0, 0.5])
"""Factors of the second derivatives in the warp of a pixel."""


def windows(x: Indices, y: Indices, warps: Float, radius: int, room_px: int, starts: Indices) -> list[Part]:
    """Return the part of the frame that each tile needs; it may reach beyond the image.

    `x`, `y`, shape (n,): places of the points in the reference, tile by tile. `warps`, shape (n, 6 or 12):
    the expected warps. `radius`: number of pixels of a subset on either side of its point. `room_px`:
    distance that is added on all sides. `starts`: number of the first point of each tile.
    """
    u, u_x, u_y, v, v_x, v_y = warps[:, :6].T
    reach_x = radius * (np.abs(1.0 + u_x) + np.abs(u_y))
    reach_y = radius * (np.abs(v_x) + np.abs(1.0 + v_y))
    if warps.shape[1] > 6:
        bulges = radius**2 * (np.abs(warps[:, 6:]).reshape(-1, 2, 3) @ _SECOND)
        reach_x, reach_y = reach_x + bulges[:, 0], reach_y + bulges[:, 1]
    to_x, to_y = x + u, y + v
    low = np.minimum.reduceat(np.stack([to_y - reach_y, to_x - reach_x]), starts, axis=1)
    high = np.maximum.reduceat(np.stack([to_y + reach_y, to_x + reach_x]), starts, axis=1)
    room = room_px + EDGE_PX
    low, high = np.floor(low) - room, np.ceil(high) + (room + 2)
    return [
        Part(int(top), int(bottom), int(left), int(right))
        for (top, left), (bottom, right) in zip(low.T.tolist(), high.T.tolist(), strict=True)
    ]
