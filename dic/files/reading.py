"""Read files that a user names, and refuse pipes, devices, folders and files that are too large."""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Protocol

MOST_TEXT_BYTES = 16 * 2**20
"""Largest size of a text file; usual files of polygons, alignments and tables are far smaller."""

MOST_IMAGE_BYTES = 2**30
"""Largest size of an image file, which is enough for 500 megapixels of 16 bit."""

_KINDS = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISDIR, "a folder"),
)


class Content(Protocol):
    """The content of a file, which is read in slices: bytes, or a `FileContent`."""

    def __len__(self) -> int:
        """Return the size in bytes."""

    def __getitem__(self, part: slice, /) -> bytes:
        """Return the bytes of a slice; fewer bytes at the end of the file."""


class FileContent:
    """The content of an open file. A slice is read when it is asked for, so a large file needs no memory.

    `identity`: device, number, size and time of the last change. Two different files have different
    identities, and a changed file has a new identity.
    """

    def __init__(self, file: BinaryIO) -> None:
        found = os.fstat(file.fileno())
        self._file, self._size = file, found.st_size
        self.identity = found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, part: slice, /) -> bytes:
        start, stop, _ = part.indices(self._size)
        self._file.seek(start)
        return self._file.read(max(0, stop - start))


@contextmanager
def opened(path: str | Path) -> Iterator[FileContent]:
    """Provide the content of a regular file; the file may be larger than the memory.

    Raises `OSError` if the file cannot be opened, or is not a regular file.
    """
    with _regular_file(path) as file:
        yield FileContent(file)


def read_bytes(path: str | Path, most_bytes: int = MOST_IMAGE_BYTES) -> bytes:
    """Return the content of a regular file.

    Python's `open` would wait forever for the writer of a named pipe, and would read from a device for ever.
    So this function refuses pipes and devices.

    `most_bytes`: largest accepted size of the file.

    Raises `OSError` if the file cannot be opened, is not a regular file, or is larger than `most_bytes`. The
    attribute ``strerror`` describes the file for an error message, such as "a named pipe".
    """
    with _regular_file(path) as file:
        found = os.fstat(file.fileno())
        if found.st_size > most_bytes:
            size = f"a file of {found.st_size / 2**20:.0f} MB, more than {most_bytes / 2**20:.0f} MB"
            raise OSError(errno.EFBIG, size, str(path))
        # Some file systems report size 0 for files that have content, and a file can grow meanwhile.
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        size = f"a file of more than {most_bytes / 2**20:.0f} MB"
        raise OSError(errno.EFBIG, size, str(path))
    return content


@contextmanager
def _regular_file(path: str | Path) -> Iterator[BinaryIO]:
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a name with a NUL character", str(path))
    # With O_NONBLOCK, opening a named pipe does not wait for a writer. Regular files ignore O_NONBLOCK.
    require_regular(path)
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(descriptor, "rb") as file:
        # Check the kind of the file again, because another program may have replaced the file by a pipe.
        _require_regular(os.fstat(descriptor), path)
        yield file


def read_text(path: str | Path) -> str:
    """Return the content of a text file in UTF-8, with or without a byte order mark.

    Raises
    ------
    OSError
        If `read_bytes` refuses the file, or if the file is larger than `MOST_TEXT_BYTES`.
    ValueError
        If the content is not valid UTF-8.
    """
    return read_bytes(path, MOST_TEXT_BYTES).decode("utf-8-sig")


def require_regular(path: str | Path) -> None:
    """Raise `OSError` if `path` is not a regular file, before a library opens the file itself."""
    _require_regular(Path(path).stat(), path)


def kind_of(mode: int) -> str:
    """Return the kind of a file from its mode, such as ``"a named pipe"``, or "" for a regular file."""
    return next((kind for is_kind, kind in _KINDS if is_kind(mode)), "")


def _require_regular(found: os.stat_result, path: str | Path) -> None:
    kind = kind_of(found.st_mode)
    if kind:
        raise OSError(errno.EINVAL, f"{kind}, not a file", str(Path(path)))
