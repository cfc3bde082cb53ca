"""Simulated kernel, Aravis library and OpenCV capture, whose cameras have the faults of a `FaultPanel`.

The cameras film on the virtual clock, and each picture shows its number.
"""

import math
import threading

import numpy as np

from drivers.cameras.gentl.device import Picture
from drivers.cameras.v4l2.abi import Buffer
from drivers.clock import Activity, SystemClock, VirtualClock
from simulators.wire.faults import CAMERA, FaultPanel
from tests.drivers.cameras import fake_aravis, fake_gentl, fake_kernel, fake_opencv

STALE_S = 60.0
"""Age in s of a picture with the fault ``stale``."""
OPENCV_GIVES_UP_S = 10.0
"""Time in s for which OpenCV waits for a silent camera."""
POLL_S = 0.005
POLLS = 1000
LEVELS = 256


class FaultyKernelCamera(fake_kernel.FakeCamera):
    """A camera of the simulated kernel, with the faults of a panel."""

    panel = FaultPanel(CAMERA)

    def strike(self, panel: FaultPanel) -> None:
        """Take the faults of the camera from `panel` from now on."""
        self.panel = panel
        self.delayed: list[tuple[float, Buffer]] = []
        self.begun: dict[int, float] = {}
        panel.when("unplug", lambda: setattr(self, "present", False), lambda: setattr(self, "present", True))
        panel.when("stall", lambda: setattr(self, "stalled", True), self._go_on)

    def _go_on(self) -> None:
        # do not expose the frames that are missing because of the stall
        self.begun_s = self.clock.now_s() - self.counter * self.interval_s
        self.stalled = False

    def pass_time(self) -> None:
        """Expose the frames that are due, with the faults that are on now."""
        if self.panel.active and self._is_due():
            for name, fault in (("drop", "lost"), ("corrupt", "damaged")):
                if self.panel.take(name) is not None:
                    self.frame_faults[self.shown] = fault
        before = len(self.filled)
        super().pass_time()
        for buffer in [self.filled.pop() for _ in range(len(self.filled) - before)][::-1]:
            if self.panel.take("stale") is not None:
                buffer.seconds -= int(STALE_S)
            delay_s = float(self.panel.take("delay") or 0.0)
            self.delayed.append((self.clock.now_s() + delay_s, buffer))
        while self.delayed and self.delayed[0][0] <= self.clock.now_s():
            self.filled.append(self.delayed.pop(0)[1])

    def picture(self, number: int) -> bytes:
        """Return the picture with a number, and record the start of its exposure."""
        data = super().picture(number)
        self.begun[int.from_bytes(data[:2], "little")] = self.begun_s + (self.counter - 1) * self.interval_s
        return data

    def _is_due(self) -> bool:
        end_s = self.begun_s + (self.counter + 1) * self.interval_s
        return self.streaming and not self.stalled and self.present and end_s <= self.clock.now_s()


class FaultyLibrary(fake_aravis.FakeLibrary):
    """The simulated Aravis library, with the faults of a panel."""

    def __init__(self, clock: VirtualClock, panel: FaultPanel) -> None:
        super().__init__(clock)
        self._panel = panel
        self._old: set[int] = set()
        self._delayed: tuple[float, int] | None = None
        panel.when("unplug", lambda: setattr(self, "gone", True), lambda: setattr(self, "gone", False))
        panel.when("stall", lambda: setattr(self, "silent", True), lambda: setattr(self, "silent", False))

    def stream_try_pop_buffer(self, stream: int) -> int:
        """Return the next buffer, with the faults that are on now."""
        if self.gone:
            return 0
        if self._delayed is None:
            buffer = super().stream_try_pop_buffer(stream)
            if not buffer or self._panel.take("drop") is not None:
                return 0
            if self._panel.take("corrupt") is not None:
                self.status[buffer - 100] = fake_aravis.MISSING_PACKETS
            if self._panel.take("stale") is not None:
                self._old.add(buffer)
            self._delayed = self.clock.now_s() + float(self._panel.take("delay") or 0.0), buffer
        ready_s, buffer = self._delayed
        if self.clock.now_s() < ready_s:
            return 0
        self._delayed = None
        return buffer

    def buffer_get_system_timestamp(self, buffer: int) -> int:
        """Return the date and time, in ns, at which the first packet of the buffer came."""
        return super().buffer_get_system_timestamp(buffer) - (buffer in self._old) * round(STALE_S * 1e9)


class FaultyDevice(fake_gentl.FakeDevice):
    """The simulated camera of a GenTL producer, with the faults of a panel."""

    def __init__(self, clock: VirtualClock, panel: FaultPanel) -> None:
        super().__init__(clock)
        self._panel = panel
        self._delayed_s: dict[int, float] = {}
        self._last: Picture | None = None
        panel.when("unplug", lambda: setattr(self, "gone", True), lambda: setattr(self, "gone", False))
        panel.when("stall", lambda: setattr(self, "silent", True), self.go_on)

    def fill(self) -> None:
        """Fill buffers with the pictures that have arrived, with the faults that are on now."""
        before = len(self.filled)
        super().fill()
        for shown in self.filled[before:]:
            if self._panel.take("drop") is not None:
                self.filled.remove(shown)
            elif self._panel.take("corrupt") is not None:
                self.faults[shown] = "incomplete"
            elif (delay_s := self._panel.take("delay")) is not None:
                self._delayed_s[shown] = self.clock.now_s() + float(delay_s)

    def pop(self) -> Picture | None:
        """Return the next picture, when it is not delayed any more."""
        if not self.gone:
            self.fill()
            if self.filled and self.clock.now_s() < self._delayed_s.get(self.filled[0], -math.inf):
                return None
        return super().pop()

    def picture(self, shown: int) -> Picture:
        """Return the picture with a number, or the last one again."""
        if self._last is None or self._panel.take("stale") is None:
            self._last = super().picture(shown)
        return self._last


class FaultyCapture(fake_opencv.FakeCapture):
    """The simulated OpenCV capture, with the faults of a panel, which OpenCV does not report."""

    def __init__(self, clock: VirtualClock, panel: FaultPanel) -> None:
        super().__init__(clock, coloured=False)
        self._panel = panel

    def read(self) -> tuple[bool, np.ndarray | None]:
        """Return the next picture in the same form as OpenCV."""
        if "unplug" in self._panel.active:
            return False, None
        if self._panel.take("drop") is not None:
            self.shown += 1
            if "drop" not in self._panel.active:
                return self.read()
        if {"stall", "drop"} & set(self._panel.active):
            self.clock.sleep(OPENCV_GIVES_UP_S)
            return False, None
        _, image = super().read()
        assert image is not None
        self.clock.sleep(float(self._panel.take("delay") or 0.0))
        if self._panel.take("corrupt") is not None:
            image[len(image) // 2 :] ^= 0xFF
        if self._panel.take("stale") is not None:
            image -= np.uint8(STALE_S / fake_opencv.INTERVAL_S % LEVELS)
        return True, image


class GatedClock(VirtualClock):
    """A virtual clock on which the thread of a stream sleeps only up to a time that the test sets."""

    def __init__(self) -> None:
        super().__init__()
        self._news = threading.Condition()
        self._until_s = math.inf
        self._waiting = False

    def activity(self, *, at_once: bool = False) -> Activity:
        """Return an activity; without effect while the test says itself how far a stream's thread goes."""
        return super().activity(at_once=at_once) if math.isinf(self._until_s) else SystemClock().activity()

    def sleep(self, duration_s: float) -> None:
        """Let simulated time pass; a stream's thread first waits until the test allows this time."""
        if threading.current_thread().name.startswith("stream"):
            with self._news:
                self._waiting = True
                self._news.notify_all()
                self._news.wait_for(lambda: self.now_s() + duration_s <= self._until_s)
                self._waiting = False
        super().sleep(duration_s)

    def hold(self) -> None:
        """Stop the threads of streams at the present time."""
        self._until_s = self.now_s()

    def let_pass(self, duration_s: float) -> bool:
        """Allow more time, and wait until a stream's thread has used it or ended; return True if it runs."""
        with self._news:
            self._until_s = self.now_s() + duration_s
            self._waiting = False
            self._news.notify_all()
            for _ in range(POLLS):
                if self._waiting or not _streams():
                    return self._waiting
                self._news.wait(POLL_S)
        raise AssertionError(f"a stream used no time for {POLLS * POLL_S:g} s")

    def release(self) -> None:
        """Let the threads of streams run without a limit of time."""
        with self._news:
            self._until_s = math.inf
            self._news.notify_all()


def _streams() -> bool:
    return any(thread.name.startswith("stream") for thread in threading.enumerate())
