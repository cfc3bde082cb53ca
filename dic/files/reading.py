"""Read files that a user names, and refuse pipes, devices, folders and files that are too large."""

import errno
import os
import stat
from pathlib import Path

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


def read_bytes(path: str | Path, most_bytes: int = MOST_IMAGE_BYTES) -> bytes:
    """Return the content of a regular file.

    Python's `open` would wait forever for the writer of a named pipe, and would read a device without end. So
    this function refuses pipes and devices.

    Parameters
    ----------
    path : path
    most_bytes : int
        Largest accepted size of the file.

    Raises
    ------
    OSError
        If the file cannot be opened, is not a regular file, or is larger than `most_bytes`. The attribute
        ``strerror`` describes the file for an error message, such as "a named pipe".
    """
    # With O_NONBLOCK, opening a named pipe does not wait for a writer. Regular files ignore O_NONBLOCK.
    require_regular(path)
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        # Check the kind of the file again, because another program may have replaced the file by a pipe.
        _require_regular(found, path)
        if found.st_size > most_bytes:
            size = f"a file of {found.st_size / 2**20:.0f} MB, more than {most_bytes / 2**20:.0f} MB"
            raise OSError(errno.EFBIG, size, str(path))
        # Some file systems report size 0 for files that have content, and a file can grow meanwhile.
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        size = f"a file of more than {most_bytes / 2**20:.0f} MB"
        raise OSError(errno.EFBIG, size, str(path))
    return content


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
