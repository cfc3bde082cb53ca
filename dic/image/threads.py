"""Threads: how many to use, and work on bands of rows in parallel.

How an image or a grid is cut never depends on the number of threads, so results do not either.
"""

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dic.typing import Indices


def processors() -> int:
    """Return how many processors this program may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux has it
        return os.cpu_count() or 1


def in_parallel(work: Callable[[slice], None], bands: Sequence[slice], threads: int) -> None:
    """Call `work` with every band on up to `threads` threads, and wait until all are done.

    Worth it for work without the interpreter's lock: compiled code, OpenCV's, NumPy's.
    """
    if threads < 2 or len(bands) < 2:
        for band in bands:
            work(band)
        return
    with ThreadPoolExecutor(min(threads, len(bands))) as pool:
        # Reading the results raises the errors of the threads.
        list(pool.map(work, bands))


def bands_of(rows: int, height: int) -> list[slice]:
    """Cut so many rows into bands of `height`; the last may be lower."""
    return [slice(first, min(first + height, rows)) for first in range(0, rows, height)]


def balanced_bands(weights: Indices, count: int) -> list[slice]:
    """Cut rows into at most `count` bands of about equal weight; bands without weight are left out.

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
