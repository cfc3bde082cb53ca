"""The newest frames of one camera in shared memory: one process writes, others read them where they are."""

import fcntl
import mmap
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame
from rig.live.memory import SharedMemory
from rig.live.pairing import Arrival

SLOTS = 6
"""Four frames wait for those of another camera, one is measured, and one is written."""

_SLOT = np.dtype(
    [("number", np.int64), ("sequence", np.int64), ("time_s", np.float64), ("time_std_s", np.float64)]
)


@dataclass(frozen=True)
class RingShape:
    """The frames of a camera: shape (height, width) and type of the grey levels, such as "uint8"."""

    shape: tuple[int, int]
    kind: str

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame, in whole pages."""
        height, width = self.shape
        size = height * width * np.dtype(self.kind).itemsize
        return -(-size // mmap.PAGESIZE) * mmap.PAGESIZE

    @property
    def size(self) -> int:
        """Bytes of the whole ring."""
        return mmap.PAGESIZE + SLOTS * self.frame_bytes


class FrameRing:
    """The newest frames of a camera.

    Each place is locked while a frame is written to it or read. So a reader never sees a part of one frame
    and a part of another. The system releases the lock of a process that was killed. The writer takes another
    place than those that are read, and waits for nobody.

    Parameters
    ----------
    frames : RingShape
    descriptor : int, optional
        That of the ring's memory, which another process has made.
    """

    def __init__(self, frames: RingShape, descriptor: int | None = None) -> None:
        self.frames = frames
        self.memory = SharedMemory(frames.size, descriptor)
        buffer: Any = self.memory.buffer
        self._slots = np.frombuffer(buffer, _SLOT, SLOTS)
        height, width = frames.shape
        kind = np.dtype(frames.kind)
        self._images = [
            np.frombuffer(buffer, kind, height * width, mmap.PAGESIZE + k * frames.frame_bytes).reshape(
                height, width
            )
            for k in range(SLOTS)
        ]
        # The locks are those of a process, so threads of one process exclude each other with this one.
        self._own = threading.Lock()

    def write(self, frame: Frame) -> None:
        """Copy a frame to the place of the oldest one that nobody reads.

        Raises
        ------
        ValueError
            If the frame has another shape or type.
        """
        image = frame.image
        if image.shape != self.frames.shape or image.dtype != np.dtype(self.frames.kind):
            (height, width), kind = self.frames.shape, self.frames.kind
            raise ValueError(f"frames of {width} x {height} px as {kind} are expected, got {image.shape}")
        with self._own:
            if self.memory.descriptor < 0:
                return
            number = int(self._slots["number"].max()) + 1
            for slot in np.argsort(self._slots["number"]).tolist():
                with self._locked(slot, fcntl.LOCK_EX) as is_free:
                    if not is_free:
                        continue
                    self._slots[slot] = (0, frame.sequence, *frame.middle)
                    np.copyto(self._images[slot], image)
                    self._slots["number"][slot] = number
                    return

    def close(self) -> None:
        """Close the memory for this process, after a frame that is being written."""
        with self._own:
            self.memory.close()

    @property
    def newest(self) -> int:
        """Number of the newest whole frame, 0 before the first one."""
        return int(self._slots["number"].max())

    def arrivals(self, after: int) -> list[Arrival]:
        """Return the whole frames with greater numbers than `after`, the oldest first."""
        found = []
        for slot in np.flatnonzero(self._slots["number"] > after).tolist():
            with self._locked(slot, fcntl.LOCK_SH) as is_whole:
                number, sequence, time_s, time_std_s = self._slots[slot].tolist()
                if is_whole and number > after:
                    found.append(Arrival(number, time_s, time_std_s, sequence))
        return sorted(found, key=lambda each: each.number)

    @contextmanager
    def held(self, number: int) -> Iterator[NDArray[Any] | None]:
        """Give the pixels of a frame, which no one changes meanwhile; None if newer ones have replaced it."""
        for slot in np.flatnonzero(self._slots["number"] == number).tolist():
            with self._locked(slot, fcntl.LOCK_SH) as is_whole:
                if is_whole and self._slots["number"][slot] == number:
                    yield self._images[slot]
                    return
        yield None

    @contextmanager
    def _locked(self, slot: int, kind: int) -> Iterator[bool]:
        """Lock a place without waiting; give False if another process uses it."""
        descriptor, has = self.memory.descriptor, False
        with suppress(OSError):
            fcntl.lockf(descriptor, kind | fcntl.LOCK_NB, 1, slot)
            has = True
        try:
            yield has
        finally:
            if has:
                fcntl.lockf(descriptor, fcntl.LOCK_UN, 1, slot)
