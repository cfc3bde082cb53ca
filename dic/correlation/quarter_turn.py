"""Exact quarter turns of a deformed image, so that only a small rotation is left to correlate.

`numpy.rot90` moves pixels and interpolates nothing. Neighbouring pixels of a subset stay side by side in the
turned image, which the kernel needs to be fast. Warps are turned with it, and back afterwards.
"""

import numpy as np

from dic.typing import Float, Indices


def quarters_of(warps: Float) -> int:
    """Return by how many quarters `numpy.rot90` must turn the deformed image to bring it nearest upright.

    Parameters
    ----------
    warps : ndarray, shape (n, 6 or 12)
        Guesses; those with NaN say nothing.

    Returns
    -------
    int
        0 to 3; 0 if nothing is known.
    """
    known = warps[np.isfinite(warps[:, :6]).all(axis=1)]
    # The rotation nearest to a gradient F is that of its symmetric and skew parts; y points down.
    along, across = (2 + known[:, 1] + known[:, 5]).sum(), (known[:, 4] - known[:, 2]).sum()
    return int(np.rint(np.arctan2(across, along) / (np.pi / 2))) % 4


def turn_warps(warps: Float, x: Indices, y: Indices, shape: tuple[int, int], quarters: int) -> Float:
    """Return warps to the deformed image as `numpy.rot90` turns it.

    One quarter takes the pixel (X, Y) of an image of width W to (Y, W - 1 - X).

    Parameters
    ----------
    warps : ndarray, shape (…, 6 or 12)
        To the image as it is.
    x, y : ndarray of int
        Points of the reference, which is not turned, of a shape that fits `warps[..., 0]`.
    shape : (int, int)
        Height and width of the image as it is.
    quarters : int
        Negative ones turn the other way.
    """
    turned = warps.copy()
    for k in range(quarters % 4):
        width = shape[1 - k % 2]
        whole = turned.copy()
        whole[..., 0], whole[..., 3] = whole[..., 0] + x, whole[..., 3] + y
        whole[..., 1] += 1.0
        whole[..., 5] += 1.0
        for to, come in ((0, 3), (6, 9)):
            turned[..., to : to + 3] = whole[..., come : come + 3]
            turned[..., come : come + 3] = -whole[..., to : to + 3]
        turned[..., 0], turned[..., 3] = turned[..., 0] - x, turned[..., 3] + width - 1 - y
        turned[..., 1] -= 1.0
        turned[..., 5] -= 1.0
    return turned


def turn_std(std: Float, quarters: int) -> Float:
    """Return standard deviations (…, 6) of warps after a turn: an odd one exchanges u and v."""
    if quarters % 2 == 0:
        return std
    return np.concatenate([std[..., 3:], std[..., :3]], axis=-1)
