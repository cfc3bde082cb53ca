"""Principal strains, and tensors in turned axes."""

import numpy as np

from dic.typing import Float


def turned(angle: Float) -> Float:
    """Return the matrices (…, 3, 3) that transform exx, eyy and exy to axes rotated by `angle`, radians."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def principal(tensor: Float) -> tuple[tuple[Float, Float, Float], Float]:
    """Return a tuple (larger principal strain, smaller one, direction of the larger), and their difference.

    The direction is in radians.
    """
    xx, yy, xy = tensor[..., 0], tensor[..., 1], tensor[..., 2]
    middle, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return (middle + radius, middle - radius, np.arctan2(xy, (xx - yy) / 2) / 2), 2 * radius
