"""The lock on a run file while a program records to it. The lock ends with the program."""

import fcntl
import os
import struct
from pathlib import Path

# Lock the first byte of the file. HDF5 itself locks with `flock`, which is independent of this kind of lock.
_LOCK = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 0, 1, 0)


def hold(descriptor: int) -> None:
    """Lock a file until `descriptor` is closed; raise BlockingIOError if another program holds the lock."""
    fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, _LOCK)


def is_recorded(path: Path) -> bool:
    """Return True if a program is recording to the run file now."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        found = fcntl.fcntl(descriptor, fcntl.F_OFD_GETLK, _LOCK)
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    kind: int = struct.unpack_from("h", found)[0]
    return kind != fcntl.F_UNLCK
