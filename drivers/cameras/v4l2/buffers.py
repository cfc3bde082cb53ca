"""The ring of buffers between camera and program: queued empty, dequeued full, queued again."""

import contextlib
import ctypes
import errno
from dataclasses import dataclass
from typing import Any

from drivers.cameras.v4l2.abi import CAPTURE, MMAP, Buffer, BufferRequest, Request
from drivers.cameras.v4l2.node import Node, translate
from drivers.errors import DeviceFault

FEWEST = 2


@dataclass(frozen=True)
class Filled:
    """A buffer that the camera has filled.

    Attributes
    ----------
    index : int
    bytes_used : int
    flags : int
        Flags of the kernel, with type of clock and source of the timestamp.
    stamp_s : float
        Timestamp of the kernel, normally on its monotonic clock.
    sequence : int
        32-bit counter of the kernel.
    """

    index: int
    bytes_used: int
    flags: int
    stamp_s: float
    sequence: int


class Buffers:
    """Mapped buffers of an opened camera.

    Parameters
    ----------
    node : Node
    device : str
        For messages.
    count : int
        Requested number of buffers; the kernel may allocate more or fewer.

    Raises
    ------
    DeviceFault
        If another program films, or the kernel allocates fewer than two buffers.
    """

    def __init__(self, node: Node, device: str, count: int) -> None:
        self._node = node
        self._maps: list[Any] = []
        self._owed: set[int] = set()
        request = BufferRequest(count=count, type=CAPTURE, memory=MMAP)
        try:
            node.ioctl(Request.REQBUFS, request)
            if request.count < FEWEST:
                raise DeviceFault(
                    device,
                    "get buffers",
                    f"at least {FEWEST}",
                    str(request.count),
                    "free memory, or choose a smaller picture",
                )
            for index in range(request.count):
                buffer = self._buffer(index)
                node.ioctl(Request.QUERYBUF, buffer)
                self._maps.append(node.map(buffer.length, buffer.offset))
        except OSError as error:
            self.close()
            raise translate(error, device, "get buffers", f"{count} buffers") from error
        except DeviceFault:
            self.close()
            raise

    def start(self) -> None:
        """Queue every buffer and let the camera fill them; raises `OSError`."""
        self._owed.clear()
        for index in range(len(self._maps)):
            self._node.ioctl(Request.QBUF, self._buffer(index))
        self._node.ioctl(Request.STREAMON, ctypes.c_int(CAPTURE))

    def stop(self) -> None:
        """Take every buffer back from the camera; raises `OSError`."""
        self._node.ioctl(Request.STREAMOFF, ctypes.c_int(CAPTURE))

    def take(self) -> Filled | None:
        """Take out the oldest filled buffer; None if there is none. Raises `OSError`."""
        # if the kernel refused all buffers, no filled buffer comes and `give_back` is never called
        self._offer()
        buffer = self._buffer(0)
        try:
            self._node.ioctl(Request.DQBUF, buffer)
        except BlockingIOError:
            return None
        stamp_s = buffer.seconds + buffer.microseconds * 1e-6
        return Filled(buffer.index, buffer.bytesused, buffer.flags, stamp_s, buffer.sequence)

    def memory(self, filled: Filled) -> memoryview:
        """Return the memory that the camera wrote; release the view before `give_back`."""
        return memoryview(self._maps[filled.index])[: filled.bytes_used]

    def give_back(self, filled: Filled) -> None:
        """Queue a buffer again; raises `OSError` if the camera is gone.

        A buffer that the kernel refuses is queued again at the next call; otherwise the ring would lose the
        buffer.
        """
        self._owed.add(filled.index)
        self._offer()

    def _offer(self) -> None:
        for index in sorted(self._owed):
            try:
                self._node.ioctl(Request.QBUF, self._buffer(index))
            except OSError as error:
                if error.errno in (errno.ENODEV, errno.ENXIO):
                    raise
                continue
            self._owed.discard(index)

    def close(self) -> None:
        """Stop and unmap; harmless when repeated. The kernel frees the buffers when the node closes."""
        with contextlib.suppress(OSError):
            self.stop()
        while self._maps:
            self._maps.pop().close()

    def _buffer(self, index: int) -> Buffer:
        return Buffer(index=index, type=CAPTURE, memory=MMAP)
