"""Reserve disk space for a file before the file grows.

HDF5 cannot close a file whose writes failed, and h5py may crash when it releases such a file. So the space
for every write is reserved beforehand, and no write fails on a full disk. `CLOSING_BYTES` are reserved in
addition, so that the file can always be closed.
"""

import ctypes
import errno
import os
import resource
from pathlib import Path
from tempfile import TemporaryFile

CLOSING_BYTES = 1 << 20
"""Space that is always reserved behind the data, for the bytes that HDF5 writes when it closes the file."""

_AHEAD_BYTES = 64 << 20
_KEEP_SIZE = 1  # the flag FALLOC_FL_KEEP_SIZE of linux/falloc.h
_NOT_OFFERED = (errno.EOPNOTSUPP, errno.ENOSYS)


class ReservedSpace:
    """Reserves disk space for one file, without changing the size of the file.

    On a file system that cannot reserve space (`fallocate`), the free space is compared instead. `descriptor`
    is the open file.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._volume_bytes = _largest_of_volume(descriptor)
        self._reserved = 0

    def require(self, end: int, more: int) -> None:
        """Reserve `more` bytes behind byte `end`, and `CLOSING_BYTES` for closing the file.

        Raise `OSError` with the number ENOSPC if the disk is full, and EFBIG if the file system or a limit of
        the process does not allow the size.
        """
        needed, largest = end + more + CLOSING_BYTES, min(self._volume_bytes, _largest_of_process())
        if needed > largest:
            raise OSError(errno.EFBIG, f"no file may be larger than {largest} bytes here")
        if needed > self._reserved:
            self._reserve(needed, min(needed + _AHEAD_BYTES, largest))

    def release(self, size: int) -> None:
        """Return the space behind byte `size` to the disk."""
        os.ftruncate(self._descriptor, size)
        self._reserved = size

    def _reserve(self, needed: int, wished: int) -> None:
        for end in (wished, needed):
            try:
                _allocate(self._descriptor, self._reserved, end - self._reserved)
            except OSError as error:
                if error.errno in _NOT_OFFERED:
                    _require_free(self._descriptor, needed)
                    return
                if end == needed:
                    raise
            else:
                self._reserved = end
                return


def largest_file_bytes(folder: Path) -> int:
    """Return the size of the largest file that the volume of `folder` and this process allow.

    Raise `OSError` if no file can be created in the folder.
    """
    with TemporaryFile(dir=folder) as file:
        return min(_largest_of_volume(file.fileno()), _largest_of_process())


def _largest_of_volume(descriptor: int) -> int:
    """Return the largest file size of the file system, which is the largest position that `lseek` accepts."""
    low, high = 0, 2**63 - 1
    while low < high:
        middle = low + (high - low + 1) // 2
        try:
            os.lseek(descriptor, middle, os.SEEK_SET)
            low = middle
        except OSError:
            high = middle - 1
    return low


def _largest_of_process() -> int:
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return 2**63 - 1 if limit == resource.RLIM_INFINITY else limit


def _allocate(descriptor: int, start: int, length: int) -> None:
    # Do not use `os.posix_fallocate`, because it changes the file's size and may write every reserved byte.
    libc = ctypes.CDLL(None, use_errno=True)
    size = ctypes.c_int64
    while libc.fallocate(descriptor, _KEEP_SIZE, size(start), size(length)) != 0:
        number = ctypes.get_errno()
        if number != errno.EINTR:
            raise OSError(number, os.strerror(number))


def _require_free(descriptor: int, needed: int) -> None:
    volume, file = os.fstatvfs(descriptor), os.fstat(descriptor)
    if volume.f_bavail * volume.f_frsize < needed - file.st_blocks * 512:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
