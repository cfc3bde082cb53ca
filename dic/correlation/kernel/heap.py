"""A priority queue of points: a binary heap in two arrays, with the largest key on top.

Python's `heapq` is not used, because numba needs a second to compile it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.jit import inner


class Queue(NamedTuple):
    """Memory of a priority queue. The caller stores the number of items in the queue."""

    keys: NDArray[np.float64]
    """Shape (places,). Priority of each item."""
    items: NDArray[np.int64]
    """Shape (places,). Indices of the queued points in the grid."""

    @classmethod
    def with_room_for(cls, places: int) -> "Queue":
        """Return an empty queue that has room for `places` items."""
        return cls(np.empty(places), np.empty(places, np.int64))


@inner
def push(queue: Queue, size: int, key: float, item: int) -> int:
    """Add an item to a queue of `size` items, and return the new size."""
    keys, items = queue.keys, queue.items
    at = size
    while at > 0 and keys[(at - 1) // 2] < key:
        keys[at], items[at] = keys[(at - 1) // 2], items[(at - 1) // 2]
        at = (at - 1) // 2
    keys[at], items[at] = key, item
    return size + 1


@inner
def pop(queue: Queue, size: int) -> int:
    """Remove the item with the largest key from a queue of `size` items, and return this item."""
    keys, items = queue.keys, queue.items
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
