"""Cross-validation on a grid: how well a map predicts points that were left out of its fit."""

from collections.abc import Callable, Iterator

import numpy as np

from dic.targets.points import GridPoints
from dic.typing import Float, Mask

FOLDS = 5


def folds(grid: GridPoints) -> Iterator[Mask]:
    """Yield boolean arrays (n,) that are True for the points to leave out, a fifth of all points at a time.

    Each array leaves out every fifth point of each line, staggered from line to line. Each point is left out
    once. Neighbours on a line are never left out together, so every prediction has points close by.
    """
    fold = (grid.index[:, 0] + 2 * grid.index[:, 1]) % FOLDS
    for number in range(FOLDS):
        left_out = fold == number
        if left_out.any():
            yield left_out


def cross_validation_rms(grid: GridPoints, prediction_errors: Callable[[Mask], Float]) -> float:
    """Return the root mean square length of the prediction errors of all points.

    Parameters
    ----------
    grid : GridPoints
    prediction_errors : callable
        Takes a boolean array (n,), fits without the points that are True there, and returns the prediction
        errors of these points, shape (left out, 2).
    """
    squares = np.concatenate([(prediction_errors(left_out) ** 2).sum(axis=1) for left_out in folds(grid)])
    return float(np.sqrt(squares.mean()))
