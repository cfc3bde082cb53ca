"""Numba's compiler with the types of the function kept, so that mypy checks compiled functions too."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile `function` on first use, keep it on disk, and release the GIL while it runs.

    Numba's disk cache watches only the file the function stands in, so a compiled function may call
    compiled functions of its own file only; otherwise an edit elsewhere would leave stale machine code.
    """
    try:
        result: F = numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:
        # No folder for the cache: installed by another user, and no home that can be written to.
        result = numba.njit(nogil=True)(function)
    return result
