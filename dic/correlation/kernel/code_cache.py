"""The files in which machine code is kept between processes, in a folder of this user alone.

All environments of a user share the files, because their names depend on what is compiled, by what and for
which processor, but not on where the package is installed. Each version has a folder of its own.
"""

import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

import llvmlite
import numpy as np

from dic.correlation.kernel.machine_code import Kind, name_of, processor

COMPILED_IN = (
    "correlation/status.py",
    "image/spline.py",
    "image/stored.py",
    "image/threads.py",
    "typing.py",
)
"""Files of `dic` outside the kernel's folder whose constants can be part of the kernel's machine code."""

_PACKAGE = Path(__file__).parents[2]

_NO_EFFECT = {"NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS"}
"""Settings of numba that leave the machine code as it is."""

_VERSIONS = 16
"""Number of versions whose machine code is kept; the folders of those that were used longest ago go."""

_VERSION_NAME = re.compile("[0-9a-f]{16}")


def cache_key(package: Path) -> str:
    """Return the name of a version's folder.

    The name is a hash of the files of `dic` that affect the machine code, of the compiler and its settings,
    and of the processor.
    """
    content = hashlib.sha256()
    kernel = sorted((package / "correlation" / "kernel").glob("*.py"))
    for source in [*kernel, *(package / name for name in COMPILED_IN)]:
        code = source.read_bytes()
        content.update(f"{source.name}\0{len(code)}\0".encode() + code)
    numpy = np.__version__.rpartition(".")[0]
    compiler = [version("numba"), llvmlite.__version__, numpy, sys.implementation.cache_tag, processor()]
    names = {name for name in os.environ if name.startswith("NUMBA_")} - _NO_EFFECT
    settings = [f"{name}={os.environ[name]}" for name in names]
    content.update("\0".join([*compiler, *sorted(settings)]).encode())
    return content.hexdigest()[:16]


def file_of(source: Path, function: str, kind: Kind) -> Path | None:
    """Return the file for the machine code of a function; None if there is no safe folder.

    `source`: the file of the function. `kind`: the types of its arguments.
    """
    folder = cache_folder()
    if folder is None:
        return None
    try:
        content = hashlib.sha256(source.read_bytes() + f"\0{function}\0{name_of(kind)}".encode())
    except OSError:  # a function that was typed in, or a package without source files
        return None
    return folder / f"{function}-{content.hexdigest()[:24]}.o"


def read(file: Path) -> list[bytes] | None:
    """Return the object files that `write` has kept; None if they are not there or damaged."""
    with suppress(OSError):
        content = file.read_bytes()
        if hashlib.sha256(content[32:]).digest() == content[:32]:
            size, images = int.from_bytes(content[32:40]), content[40:]
            return [images[:size], images[size:]]
    return None


def write(file: Path, images: list[bytes]) -> None:
    """Keep two object files. Readers never see half a file."""
    content = len(images[0]).to_bytes(8) + images[0] + images[1]
    # What cannot be kept is compiled again.
    with suppress(OSError):
        if not file.parent.is_dir():
            file.parent.mkdir(mode=0o700, exist_ok=True)
            _prune(file.parent)
        part = file.with_name(f"{file.name}.{os.getpid()}")
        try:
            part.write_bytes(hashlib.sha256(content).digest() + content)
            part.replace(file)
        finally:
            part.unlink(missing_ok=True)


def _prune(folder: Path) -> None:
    """Remove the folders of the versions that were used longest ago.

    A process that still runs such a version has its machine code in memory, and can write its folder again.
    """
    found = [each for each in folder.parent.iterdir() if _VERSION_NAME.fullmatch(each.name)]
    found.sort(key=lambda each: each.stat().st_mtime, reverse=True)
    for each in found[_VERSIONS:]:
        shutil.rmtree(each, ignore_errors=True)


@cache
def cache_folder() -> Path | None:
    """Return the folder of this version, in the first folder that nobody else can write, or None.

    Whoever can write machine code into the folder can run programs as this user.
    """
    private = _private_folder()
    if private is None:
        return None
    try:
        folder = private / cache_key(_PACKAGE)
    except OSError:  # a package without source files
        return None
    with suppress(OSError):
        os.utime(folder)
    return folder


def _private_folder() -> Path | None:
    """Return the folder for the machine code of all versions."""
    # A folder that the user chose for numba's cache takes precedence.
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        with suppress(OSError):
            Path(chosen).mkdir(parents=True, exist_ok=True)
        return Path(chosen)
    user = os.geteuid() if hasattr(os, "geteuid") else "cache"
    folders = [Path(tempfile.gettempdir()) / f"offaxis-{user}"]
    caches = os.environ.get("XDG_CACHE_HOME")
    # A user without a home folder has only the folder of temporary files.
    with suppress(RuntimeError):
        folders.insert(0, Path(caches or Path("~/.cache").expanduser()) / "offaxis")
    return next((folder for folder in folders if folder.is_absolute() and _make_private(folder)), None)


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
