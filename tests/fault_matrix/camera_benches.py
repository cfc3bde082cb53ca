"""Benches of all camera drivers, with simulated cameras that have faults.

The simulated cameras replace the kernel's calls, the Aravis library and OpenCV's capture, as in the drivers'
own tests. Each picture shows its number, so that a test can check what a driver says about the picture.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from drivers.cameras.aravis.camera import AravisCamera
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.opencv.camera import OpencvCamera, OpencvCameraSettings
from drivers.cameras.v4l2.camera import open_camera as open_v4l2
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import Frame, OpenContext
from drivers.streams.stream import FrameStream
from rig.engine.image_checks import ImageChecks
from rig.protocol.images import Images
from simulators.rig.camera import SPEC
from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings
from simulators.wire.faults import CAMERA, FaultPanel
from tests.drivers.cameras import fake_aravis, fake_gentl, fake_kernel, fake_opencv
from tests.fault_matrix.bench import Bench, ReportedFault, UnprovenError, WrongAnswerError
from tests.fault_matrix.faulty_cameras import (
    LEVELS,
    FaultyCapture,
    FaultyDevice,
    FaultyKernelCamera,
    FaultyLibrary,
    GatedClock,
)

IMAGE_S = 1.5
SERIES_S = 2.5
"""Duration in s of a stream, longer than the time after which a silent camera counts as lost."""
LEAST_FRAMES = 40
"""Smallest number of frames in `SERIES_S`, for all simulated cameras."""
STREAM_CAPACITY = 1000
TINY_S = 1e-6
EXPOSURE_US = 10_000.0


class CameraBench(Bench):
    """A camera whose images are checked in the same way as in a run."""

    talks_on_opening = False

    def __init__(self) -> None:
        super().__init__()
        self.uses = {"image": self._image}
        self.ways_back = {"": lambda: None, "open": self.open}

    def prepare(self) -> None:
        """Take a first image."""
        self._image()

    def works(self) -> None:
        """Take an image."""
        self._image()

    def _image(self) -> None:
        checks, settings = ImageChecks(self.driver.info, Images()), Images()
        for _ in range(settings.attempts):
            asked_s = self.clock.now_s()
            frame = self.driver.grab(IMAGE_S)
            checks.require_format(frame, "one", "step 1")
            stale = checks.not_fresh(frame, asked_s)
            if stale is None:
                self.judge(frame, asked_s)
                return
        raise DeviceFault("one", "step 1", *stale)

    @abstractmethod
    def judge(self, frame: Frame, asked_s: float) -> None:
        """Raise `WrongAnswerError` if a frame, requested at `asked_s`, is not what the driver says."""


class NumberedBench(CameraBench):
    """A simulated camera that records when the exposure of each numbered picture began.

    Attributes
    ----------
    proves : bool
        True if the driver promises that its frames are complete and new.
    more : dict of str to object
        Further settings of the camera.
    """

    proves = True
    more: Mapping[str, Any] = {}

    def __init__(self) -> None:
        super().__init__()
        self.clock = GatedClock()
        self.clock.sleep(100.0)
        self.faults = FaultPanel(CAMERA)

    def judge(self, frame: Frame, asked_s: float) -> None:
        """Check that the picture is complete, and that its exposure began after the request."""
        if frame.image.min() != frame.image.max():
            raise self._wrong("half a picture called a whole one")
        begun_s = self.begun_s(int(frame.image[0, 0]))
        if begun_s < asked_s - TINY_S:
            raise self._wrong(f"asked at {asked_s:.3f} s, got a picture begun at {begun_s:.3f} s")

    def _wrong(self, what: str) -> Exception:
        return WrongAnswerError(what) if self.proves else UnprovenError(what)

    @abstractmethod
    def begun_s(self, level: int) -> float:
        """Return the true start of exposure of the last picture with the grey level `level`."""


class StreamBench(NumberedBench):
    """A camera's stream, whose report must list every missing frame."""

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
        """Check that the stream has no loss; if the stream has ended, begin a new one."""
        if not self._there:
            self.prepare()
        self._series()

    def shut(self) -> None:
        """Close the stream and the driver."""
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
            self.judge(frame, begun_s - SERIES_S)
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


class V4l2Bench(NumberedBench):
    """The driver `v4l2` on a simulated kernel."""

    def __init__(self) -> None:
        super().__init__()
        # the first packet of a USB camera comes at the end of the exposure
        self.camera = FaultyKernelCamera(self.clock, stamp_offset_s=EXPOSURE_US * 1e-6)
        self.camera.strike(self.faults)

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = V4l2Settings(
            device="serial:A17",
            format="Y12",
            width_px=32,
            height_px=20,
            rate_hz=32.0,
            exposure_us=EXPOSURE_US,
            transfer_us=0.0,
        )
        return open_v4l2(settings, context, fake_kernel.FakeSystem([self.camera]))

    def begun_s(self, level: int) -> float:
        """Return when the exposure of the last picture of that grey level began."""
        return self.camera.begun[level]

    def left_behind(self) -> dict[str, int]:
        """Return the numbers of device nodes and buffers that the simulated kernel still holds."""
        return {"nodes": self.camera.open_nodes, "buffers": self.camera.mapped}


class AravisBench(NumberedBench):
    """The driver `aravis` on a simulated library."""

    def __init__(self) -> None:
        super().__init__()
        self._library = FaultyLibrary(self.clock, self.faults)

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = AravisSettings(
            camera="G1",
            format="Mono16",  # a stream in virtual time soon shows a number beyond 12 bits
            width_px=fake_aravis.WIDTH,
            height_px=fake_aravis.HEIGHT,
            rate_hz=1 / fake_aravis.INTERVAL_S,
            exposure_us=5000.0,
            **self.more,
        )
        return AravisCamera(settings, context, self._library)  # type: ignore[arg-type]

    def begun_s(self, level: int) -> float:
        """Return the true start of exposure of the picture with the grey level `level`."""
        return self._library.begun_s + level * fake_aravis.INTERVAL_S

    def left_behind(self) -> dict[str, int]:
        """Return the numbers of objects and buffers that the simulated library still holds."""
        return {"objects": self._library.held}


class GentlBench(NumberedBench):
    """The driver `gentl` on a simulated producer."""

    def __init__(self) -> None:
        super().__init__()
        self.camera = FaultyDevice(self.clock, self.faults)
        self._producers: list[fake_gentl.FakeProducer] = []
        self.stamp = "arrival"

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        self._producers.append(fake_gentl.FakeProducer(self.camera))
        settings = {"format": "Mono16", "stamp": self.stamp} | self.more
        return fake_gentl.opened(self._producers[-1], context, **settings)

    def begun_s(self, level: int) -> float:
        """Return the true start of exposure of the picture with the grey level `level`."""
        return self.camera.begun(level)

    def left_behind(self) -> dict[str, int]:
        """Return the numbers of connections and producers that the driver still holds."""
        return {"connections": self.camera.connections, "producers": sum(p.users for p in self._producers)}


class OpencvBench(NumberedBench):
    """The driver `opencv-camera`, which states that it cannot detect old or damaged frames."""

    proves = False

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = OpencvCameraSettings(
            source=0, width_px=32, height_px=20, rate_hz=1 / fake_opencv.INTERVAL_S, channel="green"
        )
        if "unplug" in self.faults.active:
            raise LinkLost(context.name, "open camera", "a camera", "none", "plug it in")
        self._capture = FaultyCapture(self.clock, self.faults)
        return OpencvCamera(settings, context, self._capture)

    def begun_s(self, level: int) -> float:
        """Return when the exposure of the last picture of that grey level began."""
        shown = self._capture.shown  # it goes on while another thread grabs
        return (shown - (shown - level) % LEVELS) * fake_opencv.INTERVAL_S

    def left_behind(self) -> dict[str, int]:
        """Return the number of cameras that OpenCV still holds open."""
        return {"captures": int(not self._capture.released)}


class V4l2StreamBench(StreamBench, V4l2Bench):
    """The driver `v4l2` with a stream."""


class AravisStreamBench(StreamBench, AravisBench):
    """The driver `aravis` with a stream."""


class GentlStreamBench(StreamBench, GentlBench):
    """The driver `gentl` with a stream, whose frames carry time stamps of the camera.

    Without stamps, nothing could tell frames that arrive late for ever from a frame that was lost.
    """

    def __init__(self) -> None:
        super().__init__()
        self.camera.values |= fake_gentl.CLOCK
        self.stamp = "start"


class SimulatedCameraBench(CameraBench):
    """The simulated camera of the virtual rig, whose frames have consecutive numbers."""

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
        """Close the driver and the rig."""
        self.shut()
        self._rig.close()

    def judge(self, frame: Frame, asked_s: float) -> None:
        """Check the frame's number, because the noise of this camera would hide a number in the picture."""
        before, self._sequence = self._sequence, frame.sequence
        if before is not None and frame.sequence != before + 1:
            raise ReportedFault((f"{frame.sequence - before - 1} frame lost",))
