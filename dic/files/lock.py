"""A lock on a file. The operating system releases the lock when the program ends, even after a crash."""

import errno
import os
import sys
from pathlib import Path

_TAKEN = {errno.EACCES, errno.EAGAIN, errno.EDEADLK}


def lock_file(path: Path) -> int:
    """Lock a file, which is created if it does not exist, until the returned descriptor is closed.

    On a system or a file system that has no locks, the file is not protected.

    Raises `BlockingIOError` if another program holds the lock. Raises `OSError` if the file cannot be opened.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            lock_descriptor(descriptor)
            # The program that held the lock before may have removed the file meanwhile.
            if path.exists() and os.path.samestat(os.fstat(descriptor), path.stat()):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def lock_descriptor(descriptor: int) -> None:
    """Lock an open file until its descriptor is closed.

    Raises `BlockingIOError` if another program holds the lock.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:
        return
    except OSError as error:
        if error.errno in _TAKEN:
            raise BlockingIOError(error.errno, "locked by another program") from error
        if error.errno not in {errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS}:
            raise
