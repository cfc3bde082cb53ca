"""Open an HDF5 file for reading, after another process has inspected it."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from dic.files.reading import kind_of

_TIMEOUT_S = 18.0
"""For a process that sleeps: one that works is ended earlier, by its own limit."""

_inspected: set[tuple[int, int, int, int]] = set()
"""Files that passed the inspection, identified by device, file number, size and time of the last change."""


class NotReadable(Exception):
    """A file cannot be read. The message describes the file that was found instead of a good one."""


def open_hdf5(path: Path) -> Any:
    """Return an open file, `h5py.File`, that holds no links to other files.

    A damaged file can crash HDF5, and with it the program that reads the file. So another process inspects
    the file first.

    Raises
    ------
    NotReadable
        If the file is missing, damaged, refused, or not HDF5.
    """
    try:
        status = path.stat()
        if kind := kind_of(status.st_mode):
            raise NotReadable(kind)
        key = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
        if key not in _inspected:
            _inspect(path)
            _inspected.add(key)
        from dic.hdf5.inspection import open_for_reading

        return open_for_reading(path)
    except FileNotFoundError as error:
        raise NotReadable("no such file") from error
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else "an error of HDF5"
        raise NotReadable(f"a file that cannot be read ({reason})") from error


def _inspect(path: Path) -> None:
    with path.open("rb"):  # raises an error with the reason if permission is missing
        pass
    command = [sys.executable, "-P", "-m", "dic.hdf5.inspection", str(path)]
    # Prevent HDF5 from loading a plugin that the file asks for.
    environment = os.environ | {"HDF5_PLUGIN_PRELOAD": "::", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_TIMEOUT_S,
            env=environment,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise NotReadable(f"a file that was not read through within {_TIMEOUT_S:g} s") from error
    except OSError as error:
        raise NotReadable(f"no process to inspect it ({error.strerror})") from error
    if done.returncode == -signal.SIGXCPU:
        raise NotReadable("a damaged file, with which HDF5 does not come to an end")
    if done.returncode < 0:
        raise NotReadable(f"a damaged file: HDF5 crashed on it (signal {-done.returncode})")
    if done.returncode > 0:
        *_, last = done.stderr.strip().splitlines() or ["no reason"]
        raise NotReadable(f"a file whose inspection failed ({last})")
    if found := " ".join(done.stdout.split()):
        raise NotReadable(found)
