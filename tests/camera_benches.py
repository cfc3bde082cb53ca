"""Every camera driver with a faulty camera behind it, for `tests.fault_matrix`.

The real drivers' cameras stand behind the seams of their own tests: the kernel's calls, Aravis' library,
OpenCV's capture. Each picture shows its number, so that what a driver says of it can be judged.
"""

import math
import threading
from typing import Any

import numpy as np

from drivers.aravis import AravisCamera
from drivers.aravis_settings import AravisSettings
from drivers.clock import VirtualClock
from drivers.errors import LinkLost
from drivers.frame_stream import FrameStream
from drivers.interfaces import Frame, OpenContext
from drivers.opencv_camera import OpencvCamera, OpencvCameraSettings
from drivers.v4l2 import open_camera as open_v4l2
from drivers.v4l2_abi import Buffer
from drivers.v4l2_settings import V4l2Settings
from rig.imaging import take_image
from simulators.camera import SPEC
from simulators.faults import CAMERA, FaultPanel
from simulators.virtual_rig import VirtualRig, VirtualRigSettings
from tests.drivers import fake_aravis, fake_kernel, fake_opencv
from tests.fault_bench import Bench, ReportedFault, UnprovenError, WrongAnswerError

IMAGE_S = 1.5
SERIES_S = 2.5
"""How long a stream is looked at: beyond the silence after which a camera counts as stalled."""
LEAST_FRAMES = 40
"""So many frames such a time has at least, by all cameras here."""
STALE_S = 60.0
"""By how much a stale picture is too old."""
STREAM_CAPACITY = 1000
POLL_S = 0.005
TINY_S = 1e-6
LEVELS = 256
OPENCV_GIVES_UP_S = 10.0
"""How long OpenCV waits for a camera that says nothing."""


class FaultyKernelCamera(fake_kernel.FakeCamera):
    """A camera under the kernel's calls, with the faults of a panel."""

    panel = FaultPanel(CAMERA)

    def strike(self, panel: FaultPanel) -> None:
        """Obey this panel from now on."""
        self.panel = panel
        self.delayed: list[tuple[float, Buffer]] = []
        self.begun: dict[int, float] = {}
        panel.when("unplug", lambda: setattr(self, "present", False), lambda: setattr(self, "present", True))
        panel.when("stall", lambda: setattr(self, "stalled", True), self._go_on)

    def _go_on(self) -> None:
        # what was not exposed meanwhile is not made up for
        self.begun_s = self.clock.now_s() - self.counter * self.interval_s
        self.stalled = False

    def pass_time(self) -> None:
        """Expose what is due, with what is wrong just now."""
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
        """Return the picture of that number, and note when its exposure began."""
        data = super().picture(number)
        self.begun[int.from_bytes(data[:2], "little")] = self.begun_s + (self.counter - 1) * self.interval_s
        return data

    def _is_due(self) -> bool:
        end_s = self.begun_s + (self.counter + 1) * self.interval_s
        return self.streaming and not self.stalled and self.present and end_s <= self.clock.now_s()


class FaultyLibrary(fake_aravis.FakeLibrary):
    """Aravis' library with the faults of a panel."""

    def __init__(self, clock: VirtualClock, panel: FaultPanel) -> None:
        super().__init__(clock)
        self._panel = panel
        self._old: set[int] = set()
        self._delayed: tuple[float, int] | None = None
        panel.when("unplug", lambda: setattr(self, "gone", True), lambda: setattr(self, "gone", False))
        panel.when("stall", lambda: setattr(self, "silent", True), lambda: setattr(self, "silent", False))

    def stream_try_pop_buffer(self, stream: int) -> int:
        """Give the next buffer, with what is wrong just now."""
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
        """Return when the buffer's first packet came, in ns of the date."""
        return super().buffer_get_system_timestamp(buffer) - (buffer in self._old) * round(STALE_S * 1e9)


class FaultyCapture(fake_opencv.FakeCapture):
    """OpenCV's camera with the faults of a panel, of which OpenCV tells nothing."""

    def __init__(self, clock: VirtualClock, panel: FaultPanel) -> None:
        super().__init__(clock, coloured=False)
        self._panel = panel

    def read(self) -> tuple[bool, np.ndarray | None]:
        """Return the next picture as OpenCV does."""
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
    """Virtual time in which a stream's thread goes on only as far as it is let."""

    def __init__(self) -> None:
        super().__init__()
        self._news = threading.Condition()
        self._until_s = math.inf
        self._waiting = False

    def sleep(self, duration_s: float) -> None:
        """Let time pass, once it may."""
        if threading.current_thread().name.startswith("stream"):
            with self._news:
                self._waiting = True
                self._news.notify_all()
                self._news.wait_for(lambda: self.now_s() + duration_s <= self._until_s)
                self._waiting = False
        super().sleep(duration_s)

    def hold(self) -> None:
        """Let no more time pass."""
        self._until_s = self.now_s()

    def let_pass(self, duration_s: float) -> bool:
        """Let time pass; return, once the thread has used it or is gone, whether it is still there."""
        with self._news:
            self._until_s = self.now_s() + duration_s
            self._waiting = False
            self._news.notify_all()
            while not self._waiting and (there := _streams()):
                self._news.wait(POLL_S)
            return bool(there) if not self._waiting else True

    def release(self) -> None:
        """Let all time pass."""
        with self._news:
            self._until_s = math.inf
            self._news.notify_all()


def _streams() -> bool:
    return any(thread.name.startswith("stream") for thread in threading.enumerate())


class CameraBench(Bench):
    """A camera whose images are judged as a run judges them.

    Attributes
    ----------
    proves : bool
        Whether the driver says that its frames are whole and fresh.
    """

    talks_on_opening = False
    proves = True

    def __init__(self) -> None:
        super().__init__()
        self.clock = GatedClock()
        self.clock.sleep(100.0)
        self.faults = FaultPanel(CAMERA)
        self.uses = {"image": self._image}
        self.ways_back = {"": lambda: None, "open": self.open}

    def prepare(self) -> None:
        """Take a first image."""
        self._image()

    def works(self) -> None:
        """Take an image."""
        self._image()

    def _image(self) -> None:
        asked_s = self.clock.now_s()
        frame = take_image(
            "one", self.driver, timeout_s=IMAGE_S, clock=self.clock, step="step 1", warn=lambda _: None
        )
        self._judge(frame, asked_s)

    def _judge(self, frame: Frame, asked_s: float) -> None:
        if frame.image.min() != frame.image.max():
            raise self._wrong("half a picture called a whole one")
        begun_s = self.begun_s(int(frame.image[0, 0]))
        if begun_s < asked_s - TINY_S:
            raise self._wrong(f"asked at {asked_s:.3f} s, got a picture begun at {begun_s:.3f} s")

    def _wrong(self, what: str) -> Exception:
        return WrongAnswerError(what) if self.proves else UnprovenError(what)

    def begun_s(self, level: int) -> float:
        """Return when the exposure of the last picture of that grey level truly began."""
        raise NotImplementedError


class StreamBench(CameraBench):
    """A camera's stream, in which nothing may be missing without being told."""

    def __init__(self) -> None:
        super().__init__()
        self._frames: FrameStream | None = None
        self._there = False
        self._taken = self._told = 0
        self._numbers: list[int] = []
        self.uses = {"stream": self._series}

    def prepare(self) -> None:
        """Begin a stream, and take its first frames."""
        self._close_stream()
        self.clock.hold()
        self._frames = self.driver.stream(STREAM_CAPACITY)
        self._there, self._taken, self._told, self._numbers = True, 0, 0, []
        self._series()

    def works(self) -> None:
        """Stream without a loss; a stream that ended begins anew."""
        if not self._there:
            self.prepare()
        self._series()

    def shut(self) -> None:
        """Close stream and driver."""
        self._close_stream()
        super().shut()

    def _close_stream(self) -> None:
        self.clock.release()
        if self._frames is not None:
            self._frames.close()
        self._frames, self._there = None, False

    def _series(self) -> None:
        frames, begun_s = self._frames, self.clock.now_s()
        assert frames is not None
        self._there = self.clock.let_pass(SERIES_S)
        report = frames.report()
        fresh = [frames.next(0.0) for _ in range(report.taken - self._taken)]
        for frame in fresh:
            self._judge(frame, begun_s - SERIES_S)
        self._numbers += [frame.sequence for frame in fresh]
        pairs = zip(self._numbers, self._numbers[1:], strict=False)
        missing = sum(after - before - 1 for before, after in pairs)
        if missing > report.lost:
            raise WrongAnswerError(f"{missing} frames missing, {report.lost} reported")
        new = report.losses[self._told :]
        self._taken, self._told = report.taken, len(report.losses)
        if not self._there:
            frames.next(0.0)  # raises what ended it
        if new:
            raise ReportedFault(tuple(loss.kind.name for loss in new))
        if len(fresh) < LEAST_FRAMES:
            raise WrongAnswerError(f"{len(fresh)} frames in {SERIES_S:g} s, and no loss")


class V4l2Bench(CameraBench):
    """`v4l2` on the kernel's calls."""

    def __init__(self) -> None:
        super().__init__()
        self.camera = FaultyKernelCamera(self.clock)
        self.camera.strike(self.faults)

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = V4l2Settings(
            device="serial:A17",
            format="Y12",
            width_px=32,
            height_px=20,
            rate_hz=32.0,
            exposure_us=10_000.0,
            transfer_us=0.0,
        )
        return open_v4l2(settings, context, fake_kernel.FakeSystem([self.camera]))

    def begun_s(self, level: int) -> float:
        """Return when the exposure of the last picture of that grey level began."""
        return self.camera.begun[level]

    def left_behind(self) -> dict[str, int]:
        """Return what the kernel still holds for the driver."""
        return {"nodes": self.camera.open_nodes, "buffers": self.camera.mapped}


class AravisBench(CameraBench):
    """`aravis` on the library's calls."""

    def __init__(self) -> None:
        super().__init__()
        self._library = FaultyLibrary(self.clock, self.faults)

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = AravisSettings(
            camera="G1",
            format="Mono12",
            width_px=fake_aravis.WIDTH,
            height_px=fake_aravis.HEIGHT,
            rate_hz=1 / fake_aravis.INTERVAL_S,
            exposure_us=5000.0,
        )
        return AravisCamera(settings, context, self._library)  # type: ignore[arg-type]

    def begun_s(self, level: int) -> float:
        """Return when the exposure of the picture of that grey level began."""
        return self._library.begun_s + level * fake_aravis.INTERVAL_S

    def left_behind(self) -> dict[str, int]:
        """Return what the library still holds for the driver."""
        return {"objects": self._library.held}


class OpencvBench(CameraBench):
    """`opencv-camera`, which says itself that it proves nothing."""

    proves = False

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        self._capture = FaultyCapture(self.clock, self.faults)
        settings = OpencvCameraSettings(
            source=0, width_px=32, height_px=20, rate_hz=1 / fake_opencv.INTERVAL_S, channel="green"
        )
        if "unplug" in self.faults.active:
            raise LinkLost(context.name, "open camera", expected="a camera", got="none", remedy="plug it in")
        return OpencvCamera(settings, context, self._capture)

    def begun_s(self, level: int) -> float:
        """Return when the exposure of the last picture of that grey level began."""
        behind = (self._capture.shown - level) % LEVELS
        return (self._capture.shown - behind) * fake_opencv.INTERVAL_S


class V4l2StreamBench(StreamBench, V4l2Bench):
    """`v4l2`, streaming."""


class AravisStreamBench(StreamBench, AravisBench):
    """`aravis`, streaming."""


class SimulatedCameraBench(CameraBench):
    """The simulated camera, whose frames are numbered one by one."""

    def __init__(self) -> None:
        super().__init__()
        self._rig = VirtualRig(VirtualRigSettings())
        self.clock = self._rig.clock
        self.faults = self._rig.faults[CAMERA]
        self._sequence: int | None = None

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        self._sequence = None
        settings = SPEC.settings(width_px=32, height_px=32)
        return SPEC.open(settings, OpenContext("cameras.one", self.clock, self._rig))

    def works(self) -> None:
        """Take two images."""
        self._sequence = None
        self._image()
        self._image()

    def close(self) -> None:
        """Close driver and rig."""
        self.shut()
        self._rig.close()

    def _judge(self, frame: Frame, asked_s: float) -> None:
        before, self._sequence = self._sequence, frame.sequence
        if before is not None and frame.sequence != before + 1:
            raise ReportedFault((f"{frame.sequence - before - 1} frame lost",))
