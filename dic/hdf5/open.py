"""Open an HDF5 file for reading, after another process has inspected it."""

import errno
import os
import signal
from pathlib import Path
from typing import Any

from dic.files.reading import kind_of
from dic.hdf5.commit import complete
from dic.hdf5.inspector import ask_inspector

_TIMEOUT_S = 18.0
"""Longest wait for an inspection. An inspection that computes for too long ends earlier by its own limit."""

_inspected: set[tuple[int, int, int, int]] = set()
"""Files that passed the inspection, identified by device, file number, size and time of the last change."""


class NotReadable(Exception):
    """A file cannot be read. The message describes the file that was found instead of a good one."""


def open_hdf5(path: Path) -> Any:
    """Return an open file, `h5py.File`, that contains no links to other files.

    A damaged file can crash HDF5, and with it the program that reads the file. So another process inspects
    the file first.

    Raises `NotReadable` if the file is missing, damaged, refused, or not HDF5.
    """
    try:
        if kind := kind_of(path.stat().st_mode):
            raise NotReadable(kind)
        complete(path)
        status = path.stat()
        key = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
        if key not in _inspected:
            _inspect(path)
            _inspected.add(key)
        from dic.hdf5.inspection import open_for_reading

        return open_for_reading(path)
    except FileNotFoundError as error:
        raise NotReadable("no such file") from error
    except OSError as error:
        if error.errno == errno.EAGAIN:
            from dic.hdf5.inspection import LOCKED

            raise NotReadable(LOCKED) from error
        reason = os.strerror(error.errno) if error.errno else "an error of HDF5"
        raise NotReadable(f"a file that cannot be read ({reason})") from error


def _inspect(path: Path) -> None:
    with path.open("rb"):  # raises an error with the reason if permission is missing
        pass
    try:
        status, said = ask_inspector(path, _TIMEOUT_S)
    except TimeoutError as error:
        raise NotReadable(f"a file that was not read through within {_TIMEOUT_S:g} s") from error
    except OSError as error:
        raise NotReadable(f"no process to inspect it ({error.strerror or error})") from error
    if status == -getattr(signal, "SIGXCPU", 0) and status:
        raise NotReadable("a damaged file, with which HDF5 does not come to an end")
    if status < 0:
        raise NotReadable(f"a damaged file: HDF5 crashed on it (signal {-status})")
    if status > 0:
        raise NotReadable("a file whose inspection failed")
    if said:
        raise NotReadable(said)
