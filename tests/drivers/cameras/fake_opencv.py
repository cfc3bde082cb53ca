"""A simulated OpenCV camera. Buffered frames come at once, without frame number, timestamp or error flag."""

import numpy as np

from drivers.clock import VirtualClock

INTERVAL_S = 0.04
WAITING = 4


class FakeCapture:
    """A simulated `VideoCapture`. Buffered frames come at once, the oldest first, and show their numbers."""

    def __init__(self, clock: VirtualClock, *, coloured: bool = True) -> None:
        self.clock = clock
        self.coloured = coloured
        self.values: dict[int, float] = {}
        self.clamped: dict[int, float] = {}
        self.shown = 0
        self.unplugged = False
        self.released = False

    def getBackendName(self) -> str:  # noqa: N802
        return "FAKE"

    def set(self, number: int, value: float) -> bool:
        self.values[number] = self.clamped.get(number, value)
        return True

    def get(self, number: int) -> float:
        return self.values.get(number, 0.0)

    def read(self) -> tuple[bool, np.ndarray | None]:
        if self.unplugged:
            return False, None
        newest = int(self.clock.now_s() / INTERVAL_S) - 1
        self.shown = max(self.shown + 1, newest - WAITING + 1)
        done_s = (self.shown + 1) * INTERVAL_S
        self.clock.sleep(max(0.0, done_s - self.clock.now_s()))
        level = self.shown % 256
        image = np.full((20, 32), level, np.uint8)
        return True, np.dstack([image // 2, image, image // 4]) if self.coloured else image

    def release(self) -> None:
        self.released = True
