"""Memory without a name that several processes share; it is gone as soon as the last of them has ended."""

import mmap
import os
import sys
import tempfile
from types import TracebackType

_PAGE = mmap.PAGESIZE


class SharedMemory:
    """Memory that the processes share which inherit its descriptor.

    A segment with a name would stay behind when all processes are killed. `descriptor` is inherited only by
    processes to which it is passed on.

    Parameters
    ----------
    size : int
        Number of bytes; rounded up to whole pages.
    descriptor : int, optional
        That of memory which another process has made. Default: new memory, filled with zeros.
    """

    def __init__(self, size: int, descriptor: int | None = None) -> None:
        self.size = -(-size // _PAGE) * _PAGE
        self.descriptor = _new(self.size) if descriptor is None else descriptor
        if sys.platform == "linux":
            # The pages are made now, and not in the first frames.
            self.buffer = mmap.mmap(self.descriptor, self.size, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE)
        else:
            self.buffer = mmap.mmap(self.descriptor, self.size)

    def __enter__(self) -> "SharedMemory":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the descriptor. Arrays in the memory stay usable. A repeated call has no effect."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def _new(size: int) -> int:
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("offaxis-live", os.MFD_CLOEXEC)
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    return descriptor
