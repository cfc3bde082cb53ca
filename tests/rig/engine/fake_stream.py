"""A camera with a stream on the clock of a test; it runs freely with a period and a phase of its own."""

from dataclasses import dataclass, field

import numpy as np

from drivers.errors import DeviceTimeout
from drivers.interfaces import Frame
from tests.rig.conftest import FakeCamera

EXPOSURE_S, READOUT_S = 0.004, 0.006


@dataclass
class FakeLoss:
    kind: object
    count: int


@dataclass
class FakeReport:
    losses: tuple[FakeLoss, ...] = ()


@dataclass
class StreamingCamera(FakeCamera):
    """`on_next(number)` is called before each frame of a stream; `on_close()` when a stream is closed."""

    period_s: float = 0.1
    on_next: object = lambda number: None
    on_close: object = lambda: None
    opened: int = 0
    report: FakeReport = field(default_factory=FakeReport)

    def stream(self, capacity: int) -> "FakeStream":
        self.opened += 1
        return FakeStream(self)


class FakeStream:
    """The exposures begin at whole periods of the clock. Frames that nobody takes in time are lost."""

    def __init__(self, camera: StreamingCamera) -> None:
        self._camera, self._clock = camera, camera.clock
        self._next = int(self._clock.now_s() / camera.period_s) + 1
        self.interval_s = self.shortest_s = camera.period_s

    def next(self, timeout_s: float) -> Frame:
        camera, clock = self._camera, self._clock
        exposed_s = self._next * camera.period_s
        wait_s = exposed_s + EXPOSURE_S + READOUT_S - clock.now_s()
        if wait_s > timeout_s:
            clock.sleep(timeout_s)
            raise DeviceTimeout("fake", "stream", "a frame", "none", "wait")
        clock.sleep(wait_s)
        number, self._next = self._next, self._next + 1
        camera.on_next(number)
        image = np.full((6, 8), number % 251, np.uint8)
        return Frame(
            image, exposed_s, max(clock.now_s(), exposed_s + EXPOSURE_S), clock.utc(), number, 0,
            1e6 * EXPOSURE_S, 1.0, exposed_s + EXPOSURE_S / 2, 1e-4,
        )  # fmt: skip

    def report(self) -> FakeReport:
        return self._camera.report

    def close(self) -> None:
        self._camera.on_close()
