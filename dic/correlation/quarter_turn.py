"""Exact turns of a deformed image by 90°, so that the remaining rotation is at most 45°.

The kernel is fast if neighbouring pixels of a subset are also neighbours in the deformed image. `numpy.rot90`
turns an image by 90° without interpolation. The warps are turned with the image, and turned back afterwards.
"""

import numpy as np

from dic.typing import Float, Indices


def quarters_of(warps: Float) -> int:
    """Return the number of quarter turns by `numpy.rot90` that undo most of the deformed image's rotation.

    `warps`, shape (n, 6 or 12): guesses of the warps. Guesses with NaN are ignored.

    Result: number of quarter turns, from 0 to 3. The number is 0 without a guess.
    """
    known = warps[np.isfinite(warps[:, :6]).all(axis=1)]
    # The rotation nearest to a gradient F has the angle atan2(F21 - F12, F11 + F22); the y axis points down.
    along, across = (2 + known[:, 1] + known[:, 5]).sum(), (known[:, 4] - known[:, 2]).sum()
    return int(np.rint(np.arctan2(across, along) / (np.pi / 2))) % 4


def turn_warps(warps: Float, x: Indices, y: Indices, shape: tuple[int, int], quarters: int) -> Float:
    """Return the warps from the reference to the deformed image after `numpy.rot90` has turned this image.

    A quarter turn moves the pixel (X, Y) of an image of width W to (Y, W - 1 - X).

    `warps`, shape (…, 6 or 12): warps from the reference to the image before the turn. `x`, `y`: coordinates
    of the points in the reference, which is not turned. The arrays are broadcast with `warps[..., 0]`.
    `shape`: height and width of the image before the turn. `quarters`: number of quarter turns. Negative
    numbers turn in the opposite direction.
    """
    turned = warps.copy()
    for k in range(quarters % 4):
        width = shape[1 - k % 2]
        whole = turned.copy()
        whole[..., 0], whole[..., 3] = whole[..., 0] + x, whole[..., 3] + y
        whole[..., 1] += 1.0
        whole[..., 5] += 1.0
        for u, v in ((0, 3), (6, 9)):
            turned[..., u : u + 3] = whole[..., v : v + 3]
            turned[..., v : v + 3] = -whole[..., u : u + 3]
        turned[..., 0], turned[..., 3] = turned[..., 0] - x, turned[..., 3] + width - 1 - y
        turned[..., 1] -= 1.0
        turned[..., 5] -= 1.0
    return turned


def turn_std(std: Float, quarters: int) -> Float:
    """Return standard deviations (…, 6) of turned warps; odd numbers of quarter turns exchange u and v."""
    if quarters % 2 == 0:
        return std
    return np.concatenate([std[..., 3:], std[..., :3]], axis=-1)
