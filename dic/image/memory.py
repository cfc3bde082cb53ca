"""Give memory that is no longer used back to the operating system."""

import ctypes
from collections.abc import Callable
from functools import cache


def give_back_memory() -> None:
    """Give freed memory back to the operating system, as far as the C library can do this.

    The C library of Linux (glibc) keeps freed blocks of up to 32 MB for later allocations. Maps and bands of
    large images are such blocks, and later stages need blocks of other sizes. Without this function, the
    memory of a stage would be added to the memory of the next stage. The call takes some milliseconds.
    """
    _trim()(0)


@cache
def _trim() -> Callable[[int], int]:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):
        # Other C libraries have no such function. They keep fewer blocks, or decide themselves.
        return lambda _: 0
