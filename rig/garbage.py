"""Keep the search for garbage from holding up a run."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def short_searches() -> Iterator[None]:
    """Within the `with` block, let Python search only what is made in it for garbage.

    Python holds all threads while it searches. The objects of all modules take it some 50 to 100 ms, which is
    longer than the time between two images or between two readings of a moving machine.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
