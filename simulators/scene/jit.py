"""Numba's compiler as a typed decorator, so that mypy checks compiled functions too."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile `function` at its first call, store the machine code on disk, and release the GIL in each call.

    A compiled function must only call compiled functions of its own file. Numba's disk cache monitors only
    this file, so after a change in another file the stored machine code would be outdated.
    """
    return _compiled(function)


def compiled_fast(function: F) -> F:
    """Compile `function` as `compiled` does, for loops that must be vector code.

    The compiler may change the order of a sum. NaN and infinity give wrong results.
    """
    return _compiled(function, fastmath=True, error_model="numpy")


def _compiled(function: F, **options: Any) -> F:
    try:
        result: F = numba.njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:
        # Compile without a cache on disk, because neither the installation folder nor the home folder is
        # writable.
        result = numba.njit(nogil=True, **options)(function)
    return result
