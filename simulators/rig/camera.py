"""A simulated camera that renders the specimen as seen from the camera's position."""

import math
import threading
from collections import deque
from dataclasses import replace
from datetime import datetime, timedelta
from zlib import crc32

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, Frame, OpenContext, Setting
from drivers.registry import DriverSpec
from drivers.streams.stream import CAPACITY, FrameStream
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.exposures import LOOKS, Beat, Exposure, Film, Start, TimedLook
from simulators.rig.picture_faults import Taken
from simulators.rig.surroundings import Surroundings
from simulators.scene.between import Look, moments
from simulators.scene.scene import Scene, Surface, scene_of

# The bit that V4L2 sets in the flags of a damaged buffer.
FLAG_ERROR = 0x40
EXPOSURES_KEPT = 256
_NO_IMAGE = np.empty((0, 0), np.uint8)
SILENCE_S = 1.0
SILENCE_FRAMES = 10
"""A stream ends if no frame comes for this time, or for this number of frame times if that is longer."""


class SimulatedCamera:
    """A camera that shows the mean of the moving scene over each exposure.

    The image noise depends only on the scene's seed, the camera's name and the frame's number. Therefore the
    images of a repeated run are identical.

    The middle of an exposure is the time at which the camera looked at the scene. Its standard deviation is
    that of a uniform distribution over the time that this took: 0 on a simulated clock, which stands still
    meanwhile.

    Parameters
    ----------
    name : str
    settings : CameraSettings
    scene : Scene
    clock : Clock
    around : Surroundings, optional
        The faults of the rig, and how pictures are drawn. Default: without faults, exactly.

    Attributes
    ----------
    info : CameraInfo
    optics : PinholeCamera
    exposure : Exposure or None
        The exposure of the last frame, with its true times and the true surface, without the picture.
    """

    def __init__(
        self,
        name: str,
        settings: CameraSettings,
        scene: Scene,
        clock: Clock,
        around: Surroundings | None = None,
    ) -> None:
        self.info = CameraInfo(
            vendor="offaxis",
            model="simulated camera",
            serial=name,
            simulated=True,
            width_px=settings.width_px,
            height_px=settings.height_px,
            bits=settings.bits,
        )
        around = around or Surroundings.of(clock)
        self.optics = settings.optics()
        self.exposure: Exposure | None = None
        self._exposures: deque[Exposure] = deque(maxlen=EXPOSURES_KEPT)
        self._name = name.removeprefix("cameras.")
        self._faults, self._pictures, self._plan = around.faults, around.pictures, around.plan
        self._before: Frame | None = None
        self._settings = settings
        self._painter = around.painter(settings, scene, name)
        self._scene = scene
        self._clock = clock
        self._sequence = 0
        self._turn = threading.Lock()
        self._open = True

    def grab(self, timeout_s: float) -> Frame:
        """Expose and return one frame.

        Raises
        ------
        DeviceTimeout
            If exposure and readout take longer than `timeout_s`.
        LinkLost
            If the camera is unplugged.
        DeviceFault
            If the camera was closed.
        """
        with self._turn:
            self._require_open("grab")
            return self._grab(timeout_s)

    def exposure_of(self, frame: Frame) -> Exposure | None:
        """Return the exposure of a frame, if it is one of the last `EXPOSURES_KEPT` frames."""
        known = (each for each in reversed(self._exposures) if each.taken.sequence == frame.sequence)
        return next(known, None)

    @property
    def shown(self) -> Surface | None:
        """The surface in the middle of the last frame's exposure."""
        return None if self.exposure is None else self.exposure.surface

    @property
    def _exposure_s(self) -> float:
        return self._settings.exposure_us * 1e-6

    def _next_exposure(self, asked_s: float) -> Start:
        """Return the start of the next exposure that is not lost."""
        lost = int(self._faults.take("drop") is not None)
        return self._begin(self._sequence + lost, asked_s)

    def _begin(self, number: int, meant_s: float) -> Start:
        """Return when an exposure begins that was meant to begin at a time."""
        late_s = self._settings.delay_us * 1e-6
        if self._settings.jitter_us:
            rng = np.random.default_rng([self._scene.seed, crc32(self.info.serial.encode()), number, 1])
            late_s += rng.uniform(0.0, self._settings.jitter_us) * 1e-6
        return Start(number, meant_s + late_s, late_s)

    def _grab(self, timeout_s: float) -> Frame:
        asked_s = self._clock.now_s()
        if "stall" in self._faults.active:
            raise self._too_late(timeout_s, "the sensor stands still")
        if self._faults.take("stale") is not None and self._before is not None:
            return self._before
        readout_s = self._readout_s()
        start = self._next_exposure(asked_s)
        needed_s = start.begins_s - asked_s + self._exposure_s + readout_s
        if not needed_s <= timeout_s:  # also True for NaN
            raise self._too_late(timeout_s, f"it takes {needed_s:g} s")
        looks = []
        for part in LOOKS:
            self._clock.sleep(start.begins_s + part * self._exposure_s - self._clock.now_s())
            looks.append(self._look())
        exposure = self._develop(start, looks, readout_s)
        self._clock.sleep(exposure.arrives_s - self._clock.now_s())
        return self._read_out(exposure)

    def _too_late(self, timeout_s: float, reason: str) -> DeviceTimeout:
        """Wait for `timeout_s`, and return the error that there is no frame."""
        self._clock.sleep(timeout_s)
        return DeviceTimeout(
            self.info.serial,
            "grab",
            f"a frame within {timeout_s:g} s",
            f"none: {reason}",
            "shorten the exposure or allow more time, and check the camera's trigger and power",
        )

    def _look(self) -> TimedLook:
        """Look at the scene now."""
        before_s = self._clock.now_s()
        surface = self._scene.surface()
        after_s = self._clock.now_s()
        time_s = (before_s + after_s) / 2
        try:
            self._plan.look(time_s, self._scene.specimen.state)
        except ValueError as error:
            raise DeviceFault(
                self.info.serial,
                "look for planned faults",
                "faults that this rig can have",
                str(error),
                "correct [[simulation.faults]]",
            ) from error
        return TimedLook(time_s, surface, (after_s - before_s) / math.sqrt(12.0))

    def _develop(self, start: Start, looks: list[TimedLook], readout_s: float) -> Exposure:
        """Draw the picture of an exposure that is over."""
        taken = Taken(self._name, start.number, start.begins_s, self._exposure_s)
        seen = [
            Look(look.time_s, self._pictures.seen(self._name, self.optics, look.surface, look.time_s))
            for look in looks
        ]
        light, faults = self._pictures.light(taken, self._settings.height_px)
        image = self._painter.paint(moments(self.optics, seen, self._exposure_s), light, start.number)
        middle = looks[1]
        return Exposure(
            taken,
            middle.time_s,
            middle.std_s,
            self._utc_of(start.begins_s),
            middle.surface,
            image,
            arrives_s=taken.end_s + readout_s,
            faults=faults,
            late_s=start.late_s,
        )

    def _read_out(self, exposure: Exposure) -> Frame:
        """Return the frame of an exposure that arrives now, with the faults that are on now."""
        image, taken, settings = exposure.image, exposure.taken, self._settings
        if self._before is not None and self._pictures.frozen(self._name):
            self._pictures.note("frozen", taken)
            image = self._before.image.copy()
        damaged = self._faults.take("corrupt") is not None
        if damaged:
            self._pictures.note("corrupt", taken, taken.begins_s)
            image[len(image) // 2 :] = 0
        self.exposure = replace(exposure, image=_NO_IMAGE)
        self._exposures.append(self.exposure)
        self._sequence = taken.sequence + 1
        unknown_s = exposure.late_s if settings.stamp == "meant" else 0.0
        self._before = Frame(
            image=image,
            exposed_s=taken.begins_s - unknown_s,
            received_s=self._clock.now_s(),
            utc=exposure.utc - timedelta(seconds=unknown_s),
            sequence=taken.sequence,
            flags=FLAG_ERROR if damaged else 0,
            exposure_us=settings.exposure_us,
            gain=settings.gain,
            middle_s=exposure.middle_s - unknown_s,
            middle_std_s=math.hypot(exposure.middle_std_s, settings.stamp_std_us * 1e-6),
        )
        return self._before

    def _readout_s(self) -> float:
        return self._settings.readout_us * 1e-6 + float(self._faults.take("delay") or 0)

    def _utc_of(self, time_s: float) -> datetime:
        return self._clock.utc() - timedelta(seconds=self._clock.now_s() - time_s)

    def read_settings(self) -> dict[str, Setting]:
        """Return the settings of sensor and readout; raise the errors of `grab` for a camera that is gone."""
        self._require_open("read settings")
        names = ("width_px", "height_px", "bits", "exposure_us", "gain", "readout_us")
        return {name: getattr(self._settings, name) for name in names}

    def close(self) -> None:
        """Release the camera; a repeated call does nothing."""
        self._open = False

    def _require_open(self, step: str) -> None:
        if not self._open:
            raise DeviceFault(self.info.serial, step, "an open camera", "a closed one", "open it again")
        self.require_plugged(step)

    def require_plugged(self, step: str) -> None:
        """Raise `LinkLost` while the camera is unplugged, or switched off by the fault `dropout`."""
        self._pictures.require_present(self.info.serial, step)
        if "unplug" in self._faults.active:
            raise LinkLost(
                self.info.serial,
                step,
                "a camera on its cable",
                "none",
                "plug the camera in and open it again",
            )


class FreeRunningCamera(SimulatedCamera):
    """A simulated camera that exposes at the times of its setting `fps`, whether or not somebody asks.

    `grab` returns the next frame whose exposure begins after the call. `stream` returns all frames.
    """

    def __init__(
        self,
        name: str,
        settings: CameraSettings,
        scene: Scene,
        clock: Clock,
        around: Surroundings | None = None,
    ) -> None:
        super().__init__(name, settings, scene, clock, around)
        if settings.fps is None:
            raise DeviceFault(name, "open", "a camera with fps", "none", "give fps")
        interval_s = (1.0 - settings.fast_ppm * 1e-6) / settings.fps
        self._beat = Beat(0, settings.shift_us * 1e-6, interval_s)
        self._stream: FrameStream | None = None
        self._stalled: Taken | None = None

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame that begins after the call. Raise `DeviceFault` if a stream is open.

        The other errors are those of `SimulatedCamera.grab`.
        """
        self._require_no_stream("grab")
        return super().grab(timeout_s)

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on. `grab` is refused until the stream is closed.

        `capacity` is the largest number of frames in the queue. Raise the errors of `grab`.
        """
        with self._turn:
            self._require_open("stream")
            self._require_no_stream("stream")
            beat = self._beat
            film = Film(
                self._clock,
                beat,
                self._exposure_s,
                start=lambda number: self._begin(number, beat.start_s(number)),
                look=self._look_streamed,
                develop=self._develop_streamed,
                read_out=self._read_out_streamed,
            )
            length_s = self._exposure_s + self._settings.readout_us * 1e-6
            self._stream = FrameStream(
                self.info.serial,
                film.next_frame,
                self._clock,
                interval_s=beat.interval_s,
                silence_s=max(SILENCE_S, SILENCE_FRAMES * beat.interval_s) + length_s,
                capacity=capacity,
                on_close=self._stream_closed,
            )
            return self._stream

    def read_settings(self) -> dict[str, Setting]:
        """Return the settings of sensor, readout and rate; the errors are those of `grab`."""
        return super().read_settings() | {"rate_hz": 1 / self._beat.interval_s}

    def close(self) -> None:
        """Release the camera and end its stream; a repeated call does nothing."""
        super().close()
        stream = self._stream
        if stream is not None:
            stream.close()

    def _next_exposure(self, asked_s: float) -> Start:
        number = self._beat.next(asked_s) + int(self._faults.take("drop") is not None)
        return self._begin(number, self._beat.start_s(number))

    def _look_streamed(self) -> TimedLook:
        self._require_open("stream")
        return self._look()

    def _develop_streamed(self, start: Start, looks: list[TimedLook]) -> Exposure | None:
        """Draw the picture of an exposure that is over. Return None if it is lost."""
        taken = Taken(self._name, start.number, start.begins_s, self._exposure_s)
        if "stall" in self._faults.active:
            self._stalled = self._stalled or taken
            self._pictures.note("stall", taken, self._stalled.begins_s)
            return None
        self._stalled = None
        if self._faults.take("drop") is not None:
            self._pictures.note("drop", taken, taken.begins_s)
            return None
        return self._develop(start, looks, self._readout_s())

    def _read_out_streamed(self, exposure: Exposure) -> Frame:
        if self._faults.take("stale") is not None and self._before is not None:
            self._pictures.note("stale", exposure.taken, exposure.taken.begins_s)
            return self._before
        return self._read_out(exposure)

    def _stream_closed(self) -> None:
        self._stream = None

    def _require_no_stream(self, step: str) -> None:
        if self._stream is not None:
            raise DeviceFault(
                self.info.serial,
                step,
                "no open stream",
                "a stream that takes every frame",
                "take the frame from the stream, or close it",
            )


def _open(settings: CameraSettings, context: OpenContext) -> SimulatedCamera:
    kind = SimulatedCamera if settings.fps is None else FreeRunningCamera
    around = Surroundings.found(context)
    camera = kind(context.name, settings, scene_of(context), context.clock, around)
    camera.require_plugged("open")
    return camera


SPEC = DriverSpec("camera", CameraSettings, _open)
