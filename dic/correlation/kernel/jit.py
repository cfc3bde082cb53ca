"""Numba's compiler with typed decorators, and a cache of machine code that is never stale.

Numba keeps machine code on disk until the file of the outermost function changes; it does not notice when an
inner function in another file changes. The kernel therefore has a cache folder of its own, named after the
content of every file that can affect its machine code.
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

COMPILED_IN = ("correlation/status.py", "image/spline.py", "image/threads.py", "typing.py")
"""Files of `dic` outside the kernel's folder that the kernel imports: their constants can be compiled in."""

_PACKAGE = Path(__file__).parents[2]

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
            # There is no folder for the cache: another user installed the package, and no home is writable.
            return cast(Function, numba.njit(**_OPTIONS)(function))


def inner(function: Function) -> Function:
    """Compile `function` for compiled callers only, which takes less time; they keep it in their cache."""
    return cast(Function, numba.njit(**_OPTIONS, **_NO_WRAPPERS)(function))


def inlined(function: Function) -> Function:
    """Compile `function` into each of its callers: for the innermost ones, which a call would slow down."""
    return cast(Function, numba.njit(forceinline=True, **_OPTIONS, **_NO_WRAPPERS)(function))


def cache_key(package: Path) -> str:
    """Return a name for the kernel's machine code, from the content of the files of the package `dic`."""
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
    except RuntimeError:  # a user without a home
        caches = Path(tempfile.gettempdir())
    return caches / "offaxis" / cache_key(_PACKAGE)
