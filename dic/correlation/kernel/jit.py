"""Numba's compiler with typed decorators, and a cache of machine code that is always up to date.

Numba keeps machine code on disk until the file of the outermost function changes. Numba does not notice that
an inner function in another file has changed. So the kernel has a cache folder of its own, whose name is a
hash of all files that can affect the machine code.
"""

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
    with _own_cache() as exists:
        try:
            return cast(Function, numba.njit(cache=exists, **_OPTIONS)(function))
        except RuntimeError:
            # numba cannot write the folder that the user chose for its cache
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
def _own_cache() -> Iterator[bool]:
    """Let numba keep machine code in this program's folder. Yield False if there is no safe folder."""
    before = numba.config.CACHE_DIR
    # A folder that the user chose for numba's cache (NUMBA_CACHE_DIR) takes precedence.
    folder = before or _cache_folder()
    numba.config.CACHE_DIR = str(folder or "")
    try:
        yield bool(folder)
    finally:
        numba.config.CACHE_DIR = before


@cache
def _cache_folder() -> Path | None:
    """Return the first folder for machine code that nobody else can write, or None.

    Whoever can write machine code into the folder can run programs as this user.
    """
    user = os.geteuid() if hasattr(os, "geteuid") else "cache"
    folders = [Path(tempfile.gettempdir()) / f"offaxis-{user}"]
    caches = os.environ.get("XDG_CACHE_HOME")
    # A user without a home folder has only the folder of temporary files.
    with suppress(RuntimeError):
        folders.insert(0, Path(caches or Path("~/.cache").expanduser()) / "offaxis")
    private = next((folder for folder in folders if folder.is_absolute() and _make_private(folder)), None)
    return None if private is None else private / cache_key(_PACKAGE)


def _make_private(folder: Path) -> bool:
    """Create a folder for this user alone, and return whether it is one."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not hasattr(os, "geteuid"):  # Windows' own folder of temporary files is private
            return True
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
            return False
        if stat.S_IMODE(found.st_mode) & 0o022:
            # Another user may have put machine code into it already.
            return False
        if stat.S_IMODE(found.st_mode) & 0o055:
            folder.chmod(0o700)
        return os.access(folder, os.W_OK | os.X_OK)
    except OSError:
        return False
