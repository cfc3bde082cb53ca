"""The live measurement in simulated time: in the thread that offers a frame, while time stands still."""

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.interfaces import CameraInfo, Frame
from rig.live.fields import FieldAnswer, FieldTasks, FieldWork
from rig.live.job import DEVICE, LiveJob, prepared, ring_of
from rig.live.measuring import Measuring, Shown
from rig.live.pairing import Arrival, Pairing
from rig.live.values import LiveReading

FIELD_DELAY_S = 0.5
"""Time after a frame at which the field that it shows is used, as if another process had solved it."""

_KEPT = 10_000
_FRAMES = 5
"""Frames of a camera that are kept: those that may wait for another camera."""


class LiveAtOnce:
    """Measures live gauges at once, in simulated time. This is a `LiveMeasurement`.

    The same frames at the same times give the same values in every repetition.

    Parameters
    ----------
    job : LiveJob
    cameras : mapping of str to CameraInfo
    clock : Clock
    field_delay_s : float
        Simulated time that the solving of a field takes.
    """

    def __init__(
        self,
        job: LiveJob,
        cameras: Mapping[str, CameraInfo],
        clock: Clock,
        field_delay_s: float = FIELD_DELAY_S,
    ) -> None:
        self._job, self._clock, self._field_delay_s = job, clock, field_delay_s
        self._frames = {name: ring_of(info) for name, info in cameras.items()}
        self._images: dict[str, deque[tuple[int, Frame]]] = {}
        self._numbers: dict[str, int] = {}
        self._measured: dict[str, int] = {}
        self._readings: deque[LiveReading] = deque(maxlen=_KEPT)
        self._answer: tuple[float, FieldAnswer] | None = None
        self._measuring: Measuring | None = None
        self._failed, self._left_out = "", 0
        # Threads of several cameras offer frames.
        self._lock = threading.Lock()

    @property
    def failed(self) -> str:
        """Why nothing is measured any more; empty while the measurement works."""
        return self._failed

    @property
    def left_out(self) -> int:
        """Number of frames that were not measured, because a newer one had come."""
        return self._left_out

    def prepare(
        self, grids: Mapping[str, NDArray[np.generic]], references: Mapping[str, NDArray[np.generic]]
    ) -> None:
        """Calibrate with an image of the grid, and prepare with a reference image, of each camera.

        Raise `DeviceError` if an image cannot be used.
        """
        setups = prepared(self._job, grids, references)
        with self._lock:
            self._work, table = FieldWork(setups), self._job.table
            self._tasks = FieldTasks(setups, table.field_every_s)
            self._pairing = Pairing(setups.cameras, self._clock.now_s())
            self._images = {name: deque(maxlen=_FRAMES) for name in setups.cameras}
            self._numbers = dict.fromkeys(setups.cameras, 0)
            self._measured = dict(self._numbers)
            self._measuring = Measuring(setups, table.camera)

    def offer(self, camera: str, frame: Frame) -> None:
        """Give a frame that has arrived, and measure what can be measured now."""
        with self._lock:
            if self._measuring is None or camera not in self._images or self._failed:
                return
            shape, kind = self._frames[camera].shape, self._frames[camera].kind
            if frame.image.shape != shape or frame.image.dtype != kind:
                self._failed = f"{DEVICE}: {camera}: a frame of another format has come; end the test"
                return
            self._numbers[camera] += 1
            arrival = Arrival(self._numbers[camera], *frame.middle, frame.sequence)
            self._images[camera].append((arrival.number, frame))
            self._pairing.arrived(camera, arrival, self._clock.now_s())
            self._measure(self._measuring)

    def take(self) -> list[LiveReading]:
        """Return the readings since the last call, the oldest first, without waiting."""
        with self._lock:
            if self._measuring is not None and not self._failed:
                # A frame may have waited for that of a camera that is missing by now.
                self._measure(self._measuring)
            found = list(self._readings)
            self._readings.clear()
            return found

    def close(self) -> None:
        """End the measurement. A repeated call has no effect."""
        with self._lock:
            self._measuring = None

    def _measure(self, measuring: Measuring) -> None:
        now_s = self._clock.now_s()
        while (together := self._pairing.next(now_s)) is not None:
            if self._answer is not None and now_s >= self._answer[0]:
                self._answer[1].give_to(measuring)
                self._answer = None
            numbers = {name: arrival.number for name, arrival in together.frames.items()}
            images = {name: dict(self._images[name])[number].image for name, number in numbers.items()}
            frames = {name: Shown(arrival, images[name]) for name, arrival in together.frames.items()}
            reading = measuring.measure(frames, together.missing)
            self._readings.append(replace(reading, known_s=now_s))
            self._left_out += sum(number - self._measured[name] - 1 for name, number in numbers.items())
            self._measured |= numbers
            if self._answer is None:
                task = self._tasks.next(numbers, reading.time_s, measuring, now_s)
                if task is not None:
                    done = self._work.done(task, {name: images[name] for name in task.frames})
                    self._answer = now_s + self._field_delay_s, done
