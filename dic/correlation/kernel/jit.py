"""Numba's compiler, with the types of the decorated function kept and a cache that cannot be stale.

Numba keeps machine code on disk as long as the file of the outermost function stays the same; an inner
function that changed in another file would go unnoticed. The kernel therefore has a cache folder of its own,
named after the content of all its files and of those whose values are compiled in.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

COMPILED_IN = ("status.py",)
"""Files beside the kernel's folder whose values are constants of the machine code."""

Function = TypeVar("Function", bound=Callable[..., Any])

# Without numba's runtime (_nrt), which counts references to arrays: the kernel allocates none.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: Function) -> Function:
    """Compile `function` to machine code at its first call, without the interpreter's lock, cached on disk.

    Division by zero gives infinity or NaN as in NumPy, and sums keep their written order.
    """
    with _own_cache():
        try:
            return cast(Function, numba.njit(cache=True, **_OPTIONS)(function))
        except RuntimeError:
            # Nowhere to keep it: installed by another user, and no home to write to.
            return cast(Function, numba.njit(**_OPTIONS)(function))


def inner(function: Function) -> Function:
    """Compile `function` for compiled callers only, which takes less time; they keep it in their cache."""
    return cast(Function, numba.njit(**_OPTIONS, **_NO_WRAPPERS)(function))


def inlined(function: Function) -> Function:
    """Compile `function` into each of its callers: for the innermost ones, which a call would slow down."""
    return cast(Function, numba.njit(forceinline=True, **_OPTIONS, **_NO_WRAPPERS)(function))


@contextmanager
def _own_cache() -> Iterator[None]:
    before = numba.config.CACHE_DIR
    # A folder that the user chose for numba's cache is respected.
    numba.config.CACHE_DIR = before or str(_cache_folder())
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


@cache
def _cache_folder() -> Path:
    content = hashlib.sha256()
    here = Path(__file__).parent
    for source in [*sorted(here.glob("*.py")), *(here.parent / name for name in COMPILED_IN)]:
        content.update(source.read_bytes())
    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # a user without a home
        caches = Path(tempfile.gettempdir())
    return caches / "offaxis" / content.hexdigest()[:16]
