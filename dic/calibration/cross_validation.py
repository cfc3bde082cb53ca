"""Cross-validation of a map: fit the map without some grid points, then predict these points."""

from collections.abc import Callable, Iterator

import numpy as np

from dic.targets.points import GridPoints
from dic.typing import Float, Mask

FOLDS = 5


def folds(grid: GridPoints) -> Iterator[Mask]:
    """Yield boolean arrays, shape (n,), one for each fit; True marks the points that this fit leaves out.

    Each array leaves out every fifth point of each grid line. The position of the left-out points changes
    from line to line. Every point is left out of exactly one fit. Neighbours on a line are never left out
    together, so each left-out point keeps neighbours in the fit.
    """
    fold = (grid.index[:, 0] + 2 * grid.index[:, 1]) % FOLDS
    for number in range(FOLDS):
        left_out = fold == number
        if left_out.any():
            yield left_out


def cross_validation_rms(grid: GridPoints, prediction_errors: Callable[[Mask], Float]) -> float:
    """Return the root mean square length of the prediction errors of all points.

    `prediction_errors`: a function that takes a boolean array, shape (n,), and fits the map without the
    points that are True in the array. The function returns the prediction errors of these points, shape (left
    out, 2).
    """
    squares = np.concatenate([(prediction_errors(left_out) ** 2).sum(axis=1) for left_out in folds(grid)])
    return float(np.sqrt(squares.mean()))
