"""Give freed memory back to the operating system, or keep it for the next image."""

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


_MMAP_THRESHOLD, _TRIM_THRESHOLD, _ARENA_MAX = -3, -1, -8  # numbers of the options in malloc.h of glibc
_LARGEST_KEPT = 32 * 2**20


@cache
def share_one_heap() -> None:
    """Let all threads that start from now on take their memory from one heap.

    glibc gives each thread a heap of its own. What a thread has freed there is of no use to other threads.
    For images of 100 megapixels this is almost 0.1 GB. The threads of this program allocate few and large
    arrays, so they hardly ever wait for each other.
    """
    option = _options()
    if option is not None:
        option(_ARENA_MAX, 1)


@cache
def keep_freed_memory() -> None:
    """Let the C library keep freed blocks of up to 32 MB in this process, as it does by default.

    The workers of Dask are started with the environment variable MALLOC_TRIM_THRESHOLD_. Their C library then
    gives each freed array back to the operating system, which must clear its pages anew for the next image.
    32 MB is the limit up to which glibc raises its thresholds by itself if no such variable is set.
    """
    option = _options()
    if option is not None:
        option(_MMAP_THRESHOLD, _LARGEST_KEPT)
        option(_TRIM_THRESHOLD, 2 * _LARGEST_KEPT)


def _options() -> Callable[[int, int], int] | None:
    """Return the function that sets options of the C library's memory; None if there is none."""
    try:
        return ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        return None


@cache
def _trim() -> Callable[[int], int]:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):
        # Other C libraries have no such function. They keep fewer blocks, or decide themselves.
        return lambda _: 0
