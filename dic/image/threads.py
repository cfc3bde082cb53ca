"""Work in parallel threads, above all on bands of rows.

The division into bands never depends on the number of threads. So the results are the same for any number of
threads.
"""

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from dic.typing import Indices

Item = TypeVar("Item")

_limit: int | None = None
"""Largest number of processors that `limited_to` allows; None for no limit."""


@contextmanager
def limited_to(count: int) -> Iterator[None]:
    """Within a `with` block, limit the number of processors that this process uses."""
    import cv2

    global _limit
    before, threads = _limit, cv2.getNumThreads()
    _limit = count
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        _limit = before
        cv2.setNumThreads(threads)


def processors() -> int:
    """Return the number of processors that this program may use."""
    try:
        there = len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux has `sched_getaffinity`
        there = os.cpu_count() or 1
    return there if _limit is None else min(there, _limit)


def in_parallel(work: Callable[[slice], None], bands: Sequence[slice], threads: int) -> None:
    """Call `work` for every band on up to `threads` threads, and wait until all calls are done.

    Threads save time only in work that releases Python's global lock, such as compiled code, OpenCV or NumPy.
    """
    if threads < 2 or len(bands) < 2:
        for band in bands:
            work(band)
        return
    with ThreadPoolExecutor(min(threads, len(bands))) as pool:
        # Read the results, because this raises any errors that occurred in the threads.
        list(pool.map(work, bands))


def one_ahead(items: Iterator[Item]) -> Iterator[Item]:
    """Yield the items; with several processors, another thread makes the next item while the caller works."""
    end: Any = object()
    if processors() < 2:
        yield from items
        return
    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(next, items, end)
        while (item := following.result()) is not end:
            following = pool.submit(next, items, end)
            yield item


def bands_of(rows: int, height: int) -> list[slice]:
    """Cut `rows` rows into bands of `height` rows; the last band may have fewer rows."""
    return [slice(first, min(first + height, rows)) for first in range(0, rows, height)]


def with_neighbours(band: slice, rows: int, halo: int) -> slice:
    """Return a band with up to `halo` more rows on either side, of an array that has `rows` rows."""
    return slice(max(0, band.start - halo), min(rows, band.stop + halo))


def balanced_bands(weights: Indices, count: int) -> list[slice]:
    """Cut rows into at most `count` bands of about equal weight, and leave out bands without weight.

    `weights`, shape (rows,): the amount of work in each row.
    """
    sums = np.cumsum(weights)
    if not sums.size or sums[-1] == 0:
        return []
    edges = np.searchsorted(sums, sums[-1] * np.arange(1, count) / count) + 1
    edges = np.unique([0, *edges, len(weights)])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges) if weights[a:b].any()]
