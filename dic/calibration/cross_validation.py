"""Cross-validation on a grid: how well a map predicts points that it was not fitted to."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from dic.targets.points import GridPoints

Float = NDArray[np.float64]

FOLDS = 5


def folds(grid: GridPoints) -> Iterator[NDArray[np.bool_]]:
    """Yield which points (n,) to leave out, a fifth at a time: every fifth of each line, staggered.

    Each point is left out once, and no line loses neighbours, so that every part of the grid is predicted
    from points close by, and its edges from within.
    """
    fold = (grid.index[:, 0] + 2 * grid.index[:, 1]) % FOLDS
    for number in range(FOLDS):
        left_out = fold == number
        if left_out.any():
            yield left_out


def missed_by(grid: GridPoints, misses: Callable[[NDArray[np.bool_]], Float]) -> float:
    """Return the root mean square length of the misses of all points, each while it was left out.

    Parameters
    ----------
    grid : GridPoints
    misses : callable
        Takes which points (n,) to leave out; returns by how much these are missed, shape (left out, 2).
    """
    squares = np.concatenate([(misses(left_out) ** 2).sum(axis=1) for left_out in folds(grid)])
    return float(np.sqrt(squares.mean()))
