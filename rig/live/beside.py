"""The live measurement in a process of its own, as the run sees it."""

import os
import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import CameraInfo, Frame
from rig.live.control import Control
from rig.live.frame_ring import FrameRing
from rig.live.given import FAILED, READING, READY, REFUSED, Given, Prepare
from rig.live.job import DEVICE, LiveJob, ring_of
from rig.live.pipes import Inbox, Outbox
from rig.live.starting import Started
from rig.live.values import LiveReading

_MODULE = "rig.live.process"
PREPARE_S = 180.0
HANG_S = 2.0
_KEPT = 10_000
"""Readings that wait to be taken; of more, the oldest are lost."""

_REMEDY = "end the test, and start it anew"
_MEND = "close other programs, or leave out the table [live]"


class LiveProcess:
    """Measures live gauges in another process. This is a `LiveMeasurement`.

    Frames are copied to shared memory on the thread that offers them, and the newest are measured. If this
    program is killed, the other processes and the memory are gone, too.

    Parameters
    ----------
    job : LiveJob
    cameras : mapping of str to CameraInfo
    hang_s : float
        Time without a sign of life after which the process counts as hanging.

    Raises
    ------
    DeviceError
        If the process cannot be started.
    """

    def __init__(self, job: LiveJob, cameras: Mapping[str, CameraInfo], hang_s: float = HANG_S) -> None:
        self._clock, self._hang_s = SystemClock(), hang_s
        self._job, self._cameras = job, dict(cameras)
        self._rings = {name: FrameRing(ring_of(info)) for name, info in cameras.items()}
        self._control = Control()
        self._woken, self._wake = os.pipe()
        os.set_blocking(self._wake, False)
        self._readings: deque[LiveReading] = deque(maxlen=_KEPT)
        self._failed, self._is_ready, self._ready_s = "", False, 0.0
        self._lock = threading.Lock()
        descriptors = [ring.memory.descriptor for ring in self._rings.values()]
        descriptors += [self._control.memory.descriptor, self._woken]
        try:
            self._started: Started | None = Started(_MODULE, descriptors, new_group=True)
        except OSError as error:
            got = error.strerror or str(error)
            raise DeviceError(DEVICE, "start a process", "a further Python process", got, _MEND) from error
        self._inbox, self._outbox = Inbox(self._started.back), Outbox(self._started.to)

    @property
    def pid(self) -> int | None:
        """Number of the process, None after its end."""
        return None if self._started is None else self._started.process.pid

    @property
    def failed(self) -> str:
        """Why nothing is measured any more; empty while the measurement works."""
        self._receive()
        if not self._failed and self._started is not None:
            silent_s = self._clock.now_s() - max(self._control.alive_s, self._ready_s)
            if self._inbox.is_closed or self._started.process.poll() is not None:
                self._started.process.wait()
                self._fail(f"its process {self._started.ending}")
            elif self._is_ready and silent_s > self._hang_s:
                self._fail(f"its process gave no sign of life for {silent_s:.1f} s")
        return self._failed

    @property
    def left_out(self) -> int:
        """Number of frames that were not measured, because a newer one had come."""
        return self._control.left_out

    def prepare(
        self, grids: Mapping[str, NDArray[np.generic]], references: Mapping[str, NDArray[np.generic]]
    ) -> None:
        """Calibrate with an image of the grid, and prepare with a reference image, of each camera.

        Raise `DeviceError` if an image cannot be used, or the process fails.
        """
        rings = {name: (ring.frames, ring.memory.descriptor) for name, ring in self._rings.items()}
        given = Given(self._job, rings, self._control.memory.descriptor, self._woken)
        end_s = self._clock.now_s() + PREPARE_S
        with suppress(OSError):
            self._outbox.send(given, PREPARE_S)
            self._outbox.send(Prepare(dict(grids), dict(references)), PREPARE_S)
        refused: Any = None
        while not (self._is_ready or self.failed or refused):
            left_s = end_s - self._clock.now_s()
            if left_s <= 0.0:
                self._fail(f"its process was not ready within {PREPARE_S:g} s")
                break
            self._inbox.wait_readable(left_s)
            refused = self._receive()
        if isinstance(refused, DeviceError):
            raise refused
        if refused or self._failed:
            raise DeviceError(DEVICE, "prepare", "gauges that are ready", refused or self._failed, _MEND)

    def offer(self, camera: str, frame: Frame) -> None:
        """Give a frame that has arrived. It is copied; the call never waits for the measurement."""
        ring = self._rings.get(camera)
        if ring is None or not self._is_ready or self._failed:
            return
        try:
            ring.write(frame)
        except ValueError as error:
            self._failed = f"{DEVICE}: {camera}: {error}; {_REMEDY}"
            return
        # A full pipe wakes the process as well.
        with suppress(BlockingIOError, BrokenPipeError), self._lock:
            if self._wake >= 0:
                os.write(self._wake, b"f")

    def take(self) -> list[LiveReading]:
        """Return the readings since the last call, the oldest first, without waiting."""
        self._receive()
        found = list(self._readings)
        self._readings.clear()
        return found

    def close(self) -> None:
        """End the measurement at once. A repeated call has no effect."""
        self._end()
        with self._lock:
            if self._wake >= 0:
                os.close(self._wake)
                os.close(self._woken)
                self._wake = -1
        for ring in self._rings.values():
            ring.close()
        self._control.memory.close()

    def _receive(self) -> Any:
        """Take messages, and return what has made the preparation impossible, None if nothing has."""
        refused = None
        for word, content in self._inbox.take() if self._started is not None else ():
            if word == READING:
                self._readings.append(content)
            elif word == READY:
                self._is_ready, self._ready_s = True, self._clock.now_s()
            elif word == REFUSED:
                refused = content
            elif word == FAILED:
                self._fail(content)
        return refused

    def _fail(self, why: str) -> None:
        self._failed = self._failed or f"{DEVICE}: {why}; {_REMEDY}"
        self._end()

    def _end(self) -> None:
        """Kill the process and those that it has started; they have nothing to save."""
        started, self._started = self._started, None
        if started is None:
            return
        with suppress(ProcessLookupError):
            os.killpg(started.process.pid, 9)
        started.process.wait()
        started.close()
