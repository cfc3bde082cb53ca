"""Bands of rows, worked on side by side.

How an image or a grid is cut never depends on the number of threads, so results do not either.
"""

import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def at_once(work: Callable[[slice], None], bands: Sequence[slice], threads: int) -> None:
    """Call `work` with every band, on so many threads, and wait for the last.

    It pays for work that leaves the interpreter's lock alone: compiled code, OpenCV's, NumPy's.
    """
    if threads < 2 or len(bands) < 2:
        for band in bands:
            work(band)
        return
    with ThreadPoolExecutor(min(threads, len(bands))) as pool:
        # Asking for the results lets errors be seen.
        list(pool.map(work, bands))


def bands_of(rows: int, height: int) -> list[slice]:
    """Cut so many rows into bands of `height`; the last is lower."""
    return [slice(first, min(first + height, rows)) for first in range(0, rows, height)]


def even_bands(weights: NDArray[np.int64], count: int) -> list[slice]:
    """Cut rows into at most `count` bands of about equal weight; one that would be empty is left out.

    Parameters
    ----------
    weights : ndarray of int, shape (rows,)
        The work in each row.
    count : int
    """
    sums = np.cumsum(weights)
    if not sums.size or sums[-1] == 0:
        return []
    edges = np.searchsorted(sums, sums[-1] * np.arange(1, count) / count) + 1
    edges = np.unique([0, *edges, len(weights)])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges) if weights[a:b].any()]


def beside(mask: Mask) -> Mask:
    """Tell which elements have a true one right above, below, to the left or to the right of them."""
    near = np.zeros_like(mask)
    near[1:] |= mask[:-1]
    near[:-1] |= mask[1:]
    near[:, 1:] |= mask[:, :-1]
    near[:, :-1] |= mask[:, 1:]
    return near
