"""The ring of buffers between a camera and the program: queued empty, taken out full, given back."""

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
        As the kernel gave them, clock and place of the stamp included.
    stamp_s : float
        Of the kernel's monotonic clock.
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
        How many to ask for; the kernel may give more or less.

    Raises
    ------
    DeviceFault
        If another program films, or the kernel gives fewer than two.
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
        self._offer()  # all may have been refused: then none comes that could be given back
        buffer = self._buffer(0)
        try:
            self._node.ioctl(Request.DQBUF, buffer)
        except BlockingIOError:
            return None
        stamp_s = buffer.seconds + buffer.microseconds * 1e-6
        return Filled(buffer.index, buffer.bytesused, buffer.flags, stamp_s, buffer.sequence)

    def memory(self, filled: Filled) -> memoryview:
        """Return what the camera wrote; to be released before `give_back`."""
        return memoryview(self._maps[filled.index])[: filled.bytes_used]

    def give_back(self, filled: Filled) -> None:
        """Queue a buffer again; raises `OSError` if the camera is gone.

        One that the kernel refuses now is offered again next time: forgotten, it would be lost for good.
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
        """Stop and unmap; harmless when repeated. The kernel frees them with the node."""
        with contextlib.suppress(OSError):
            self.stop()
        while self._maps:
            self._maps.pop().close()

    def _buffer(self, index: int) -> Buffer:
        return Buffer(index=index, type=CAPTURE, memory=MMAP)
