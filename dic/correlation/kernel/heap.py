"""A queue of points, the best first: a binary heap in two arrays.

Python's `heapq` would do, but it takes a second to compile.
"""

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.jit import inner

Keys = NDArray[np.float64]
Items = NDArray[np.int64]


@inner
def push(keys: Keys, items: Items, size: int, key: float, item: int) -> int:
    """Add an item to a heap of so many; return the new size."""
    at = size
    while at > 0 and keys[(at - 1) // 2] < key:
        keys[at], items[at] = keys[(at - 1) // 2], items[(at - 1) // 2]
        at = (at - 1) // 2
    keys[at], items[at] = key, item
    return size + 1


@inner
def pop(keys: Keys, items: Items, size: int) -> int:
    """Remove the item with the largest key from a heap of so many, which becomes one smaller; return it."""
    best: int = items[0]
    last = size - 1
    key, item = keys[last], items[last]
    at, child = 0, 1
    while child < last:
        if child + 1 < last and keys[child + 1] > keys[child]:
            child += 1
        if not keys[child] > key:
            break
        keys[at], items[at] = keys[child], items[child]
        at, child = child, 2 * child + 1
    keys[at], items[at] = key, item
    return best
