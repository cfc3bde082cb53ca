"""Ring of image buffers. The camera fills a queued buffer, and the program takes it and queues it again."""

import contextlib
import ctypes
import errno
from dataclasses import dataclass
from typing import Any

from drivers.cameras.v4l2.abi import CAPTURE, MMAP, Buffer, BufferRequest, RequestCode
from drivers.cameras.v4l2.node import Node, translating
from drivers.errors import DeviceError, DeviceFault

FEWEST = 2


@dataclass(frozen=True)
class Filled:
    """A buffer that the camera has filled."""

    index: int
    bytes_used: int
    flags: int  # flags from the kernel, which include the clock type and the source of the timestamp
    stamp_s: float  # timestamp from the kernel in seconds, normally on the kernel's monotonic clock
    sequence: int  # frame number from the kernel's 32-bit counter


class Buffers:
    """The image buffers of an opened camera, mapped into the memory of the program.

    `count` is the requested number of buffers. The kernel may allocate more or fewer. Raise `DeviceFault` if
    another program films with the camera, or the kernel allocates fewer than two buffers.
    """

    def __init__(self, node: Node, device: str, count: int) -> None:
        self._node = node
        self._maps: list[Any] = []
        self._owed: set[int] = set()
        request = BufferRequest(count=count, type=CAPTURE, memory=MMAP)
        try:
            with translating(device, "get buffers", f"{count} buffers"):
                node.ioctl(RequestCode.REQBUFS, request)
                if request.count < FEWEST:
                    remedy = "free memory, or choose a smaller picture"
                    raise DeviceFault(device, "get buffers", f"at least {FEWEST}", str(request.count), remedy)
                for index in range(request.count):
                    buffer = self._buffer(index)
                    node.ioctl(RequestCode.QUERYBUF, buffer)
                    self._maps.append(node.map(buffer.length, buffer.offset))
        except DeviceError:
            self.close()
            raise

    def start(self) -> None:
        """Queue every buffer and start filming. Raise `OSError` if the kernel refuses."""
        self._owed.clear()
        for index in range(len(self._maps)):
            self._node.ioctl(RequestCode.QBUF, self._buffer(index))
        self._node.ioctl(RequestCode.STREAMON, ctypes.c_int(CAPTURE))

    def stop(self) -> None:
        """Stop filming and take every buffer back from the camera. Raise `OSError` if the kernel refuses."""
        self._node.ioctl(RequestCode.STREAMOFF, ctypes.c_int(CAPTURE))

    def take(self) -> Filled | None:
        """Dequeue the oldest filled buffer, or return None if no buffer is filled. May raise `OSError`."""
        # Queue the buffers that the kernel refused before. If it has refused all of them, `give_back` is not
        # called, so it cannot queue them.
        self._offer()
        buffer = self._buffer(0)
        try:
            self._node.ioctl(RequestCode.DQBUF, buffer)
        except BlockingIOError:
            return None
        stamp_s = buffer.seconds + buffer.microseconds * 1e-6
        return Filled(buffer.index, buffer.bytesused, buffer.flags, stamp_s, buffer.sequence)

    def memory(self, filled: Filled) -> memoryview:
        """Return a view of the bytes in a filled buffer. Release the view before `give_back`."""
        return memoryview(self._maps[filled.index])[: filled.bytes_used]

    def give_back(self, filled: Filled) -> None:
        """Queue a buffer again. Raise `OSError` if the camera was unplugged.

        If the kernel refuses a buffer, the next call of `give_back` or `take` queues this buffer again.
        """
        self._owed.add(filled.index)
        self._offer()

    def _offer(self) -> None:
        for index in sorted(self._owed):
            try:
                self._node.ioctl(RequestCode.QBUF, self._buffer(index))
            except OSError as error:
                if error.errno in (errno.ENODEV, errno.ENXIO):
                    raise
                continue
            self._owed.discard(index)

    def close(self) -> None:
        """Stop filming and unmap the buffers. The kernel frees the buffers when the node is closed."""
        with contextlib.suppress(OSError):
            self.stop()
        while self._maps:
            self._maps.pop().close()

    def _buffer(self, index: int) -> Buffer:
        return Buffer(index=index, type=CAPTURE, memory=MMAP)
