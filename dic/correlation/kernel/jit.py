"""Numba's compiler with typed decorators, and a cache of machine code that is always up to date.

Numba keeps machine code on disk until the file of the outermost function changes. Numba does not notice that
an inner function in another file has changed. So the kernel has a cache folder of its own, whose name is a
hash of all files that can affect the machine code.
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

COMPILED_IN = (
    "correlation/status.py",
    "image/spline.py",
    "image/stored.py",
    "image/threads.py",
    "typing.py",
)
"""Files of `dic` outside the kernel's folder whose constants can be part of the kernel's machine code."""

_PACKAGE = Path(__file__).parents[2]

Function = TypeVar("Function", bound=Callable[..., Any])

# Compile without numba's runtime (_nrt), which counts references to arrays. The kernel allocates no arrays.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: Function) -> Function:
    """Compile `function` to machine code at its first call, and cache the machine code on disk.

    The machine code runs without Python's global lock. Division by zero gives infinity or NaN as in NumPy.
    The order of the terms in a sum stays as it is written.
    """
    with _own_cache():
        try:
            return cast(Function, numba.njit(cache=True, **_OPTIONS)(function))
        except RuntimeError:
            # There is no folder for the cache, because another user installed the package and there is no
            # home folder.
            return cast(Function, numba.njit(**_OPTIONS)(function))


def inner(function: Function) -> Function:
    """Compile `function` for calls from compiled functions only, which saves time at compilation."""
    return cast(Function, numba.njit(**_OPTIONS, **_NO_WRAPPERS)(function))


def inlined(function: Function) -> Function:
    """Compile `function` into each of its callers, so that calls of an innermost function take no time."""
    return cast(Function, numba.njit(forceinline=True, **_OPTIONS, **_NO_WRAPPERS)(function))


def cache_key(package: Path) -> str:
    """Return the name of the cache folder, a hash of the files of `dic` that affect the machine code."""
    content = hashlib.sha256()
    kernel = sorted((package / "correlation" / "kernel").glob("*.py"))
    for source in [*kernel, *(package / name for name in COMPILED_IN)]:
        content.update(f"{source.name}\0{source.stat().st_size}\0".encode())
        content.update(source.read_bytes())
    return content.hexdigest()[:16]


@contextmanager
def _own_cache() -> Iterator[None]:
    before = numba.config.CACHE_DIR
    # A folder that the user chose for numba's cache (NUMBA_CACHE_DIR) takes precedence.
    numba.config.CACHE_DIR = before or str(_cache_folder())
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


@cache
def _cache_folder() -> Path:
    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # the user has no home folder
        caches = Path(tempfile.gettempdir())
    return caches / "offaxis" / cache_key(_PACKAGE)
