"""Exact quarter turns of a deformed image, so that at most 45° of rotation are left to correlate.

The kernel is fast if neighbouring pixels of a subset are neighbours in the deformed image, too. `numpy.rot90`
turns an image without interpolation. Warps are turned with the image, and turned back afterwards.
"""

import numpy as np

from dic.typing import Float, Indices


def quarters_of(warps: Float) -> int:
    """Return by how many quarters `numpy.rot90` must turn the deformed image to undo most of its rotation.

    Parameters
    ----------
    warps : ndarray, shape (n, 6 or 12)
        Guesses; those with NaN are ignored.

    Returns
    -------
    int
        0 to 3; 0 without a guess.
    """
    known = warps[np.isfinite(warps[:, :6]).all(axis=1)]
    # Nearest rotation to a gradient F: its angle is atan2(F21 - F12, F11 + F22). y points down.
    along, across = (2 + known[:, 1] + known[:, 5]).sum(), (known[:, 4] - known[:, 2]).sum()
    return int(np.rint(np.arctan2(across, along) / (np.pi / 2))) % 4


def turn_warps(warps: Float, x: Indices, y: Indices, shape: tuple[int, int], quarters: int) -> Float:
    """Return warps from the reference to the deformed image after `numpy.rot90`.

    One quarter takes the pixel (X, Y) of an image of width W to (Y, W - 1 - X).

    Parameters
    ----------
    warps : ndarray, shape (…, 6 or 12)
        To the image before it is turned.
    x, y : ndarray of int
        Points of the reference, which is not turned; broadcast with `warps[..., 0]`.
    shape : (int, int)
        Height and width of the image before it is turned.
    quarters : int
        Negative numbers turn the other way.
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
    """Return standard deviations (…, 6) of turned warps: an odd number of quarters exchanges u and v."""
    if quarters % 2 == 0:
        return std
    return np.concatenate([std[..., 3:], std[..., :3]], axis=-1)
