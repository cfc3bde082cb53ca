"""A simulated camera that renders the specimen as seen from the camera's position."""

import math
import threading
from dataclasses import fields
from datetime import datetime, timedelta
from typing import Literal
from zlib import crc32

import numpy as np
from pydantic import Field, model_validator

from drivers.clock import Clock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, Frame, OpenContext, Setting
from drivers.registry import DriverSpec
from drivers.settings import Settings
from drivers.streams.stream import CAPACITY, FrameStream
from simulators.rig.exposures import Beat, Exposure, Film
from simulators.rig.picture_faults import PictureFaults
from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Scene, Surface, scene_of
from simulators.scene.sensor import Sensor
from simulators.wire.faults import CAMERA, FaultPanel
from simulators.wire.rig_faults import RigFaults

# The bit that V4L2 sets in the flags of a damaged buffer.
FLAG_ERROR = 0x40
# Sine of the smallest allowed angle between the ray of a pixel and the grid's plane. This angle leaves room
# for a tilt of the surface by some degrees.
GRAZING = 0.2
SILENCE_S = 1.0
SILENCE_FRAMES = 10
"""A stream ends if no frame comes for this time, or for this number of frame times if that is longer."""


class CameraSettings(Settings):
    """Position, lens and sensor of the camera."""

    width_px: int = Field(default=900, ge=16, le=8192)
    height_px: int = Field(default=900, ge=16, le=8192)
    bits: Literal[8, 12] = Field(default=8, description="significant bits of a pixel")
    focal_px: float = Field(default=2800.0, gt=0, description="distance from the pinhole to the sensor")
    distance_mm: float = Field(
        default=40.0, gt=0, description="distance from the pinhole to the middle of the grid"
    )
    pan_deg: float = Field(default=0.0, ge=-60, le=60, description="a positive angle moves the camera to +X")
    tilt_deg: float = Field(default=0.0, ge=-60, le=60, description="a positive angle moves the camera to +Y")
    k1_per_px2: float = Field(
        default=0.0, description="radial distortion k1: x (1 + k1 r²), in px from the image's middle"
    )
    exposure_us: float = Field(default=10_000.0, gt=0)
    gain: float = Field(default=1.0, gt=0)
    readout_us: float = Field(
        default=20_000.0, ge=0, description="time from the end of exposure to the frame's arrival"
    )
    fps: float | None = Field(
        default=None,
        gt=0,
        le=10_000,
        description="frames per second of a camera that runs freely: frame k starts at k / fps on the rig's "
        "clock. Without it, the camera exposes when it is asked",
    )
    shift_us: float = Field(
        default=0.0, ge=0, description="with fps, time by which all frames start later than k / fps"
    )
    # 32 500 electrons give a noise of one grey level (8 bit) in mid-grey.
    full_well_e: float = Field(
        default=32_500.0, gt=0, description="number of electrons for the highest grey level"
    )
    read_noise_e: float = Field(default=20.0, ge=0, description="dark noise in electrons")
    saturation_exposure_us: float = Field(
        default=12_000.0, gt=0, description="exposure at which a white surface saturates"
    )

    def optics(self) -> PinholeCamera:
        """Return the lens and the position of the camera."""
        return PinholeCamera(**{each.name: getattr(self, each.name) for each in fields(PinholeCamera)})

    def sensor(self) -> Sensor:
        """Return the sensor of the camera."""
        return Sensor(self.bits, self.full_well_e, self.read_noise_e, self.saturation_exposure_us)

    @model_validator(mode="after")
    def _fits_between_frames(self) -> "CameraSettings":
        if self.fps is not None and self.exposure_us * self.fps > 1e6:
            raise ValueError(f"exposure_us must not be longer than a frame ({1e6 / self.fps:.0f} µs at fps)")
        if self.fps is None and self.shift_us:
            raise ValueError("shift_us needs fps: a camera that exposes when it is asked has no beat")
        return self

    @model_validator(mode="after")
    def _can_see_its_corners(self) -> "CameraSettings":
        optics = self.optics()
        right, bottom = self.width_px - 1.0, self.height_px - 1.0
        corners = np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
        _, directions = optics.ray(corners)
        if np.any(directions[:, 2] > -GRAZING * np.linalg.norm(directions, axis=1)):
            raise ValueError(
                "it looks past the specimen's plane; a longer focal_px, or less pan and tilt, is expected"
            )
        return self


class SimulatedCamera:
    """A camera that renders the state of the scene in the middle of each exposure.

    The image noise depends only on the scene's seed, the camera's name and the frame's number. Therefore the
    images of a repeated run are identical.

    The middle of an exposure is the time at which the camera looked at the scene. Its standard deviation is
    that of a uniform distribution over the time that this took: 0 on a simulated clock, which stands still
    meanwhile.

    Attributes
    ----------
    info : CameraInfo
    optics : PinholeCamera
    shown : Surface or None
        The surface in the last frame.
    """

    def __init__(
        self,
        name: str,
        settings: CameraSettings,
        scene: Scene,
        clock: Clock,
        faults: FaultPanel | None = None,
        pictures: PictureFaults | None = None,
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
        self.optics = settings.optics()
        self.shown: Surface | None = None
        self._faults = faults or FaultPanel(CAMERA)
        self._pictures = pictures or PictureFaults(clock)
        self._before: Frame | None = None
        self._settings = settings
        self._sensor = settings.sensor()
        self._scene = scene
        self._clock = clock
        self._sequence = 0
        self._turn = threading.Lock()
        self._stream: FrameStream | None = None
        self._open = True

    def grab(self, timeout_s: float) -> Frame:
        """Expose and return one frame, or the next one of a camera that runs freely.

        Raises
        ------
        DeviceTimeout
            If waiting, exposure and readout take longer than `timeout_s`.
        LinkLost
            If the camera is unplugged.
        DeviceFault
            If the camera was closed, or a stream is open.
        """
        with self._turn:
            self._require_free("grab")
            return self._grab(timeout_s)

    def stream(self, capacity: int = CAPACITY) -> FrameStream:
        """Return a stream of all frames from now on. `grab` is refused until the stream is closed.

        Without the setting `fps`, an exposure begins as soon as the frame before was read out. `capacity` is
        the largest number of frames in the queue. Raise the errors of `grab`.
        """
        with self._turn:
            self._require_free("stream")
            beat = self._beat()
            middle_s = self._exposure_s / 2
            film = Film(self._clock, beat, middle_s, self._expose_streamed, self._read_out_streamed)
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

    @property
    def _exposure_s(self) -> float:
        return self._settings.exposure_us * 1e-6

    def _beat(self) -> Beat:
        """Return when this camera exposes: always at the same times, or from now on."""
        if self._settings.fps is not None:
            return Beat(0, self._settings.shift_us * 1e-6, 1 / self._settings.fps)
        length_s = self._exposure_s + self._settings.readout_us * 1e-6
        return Beat(self._sequence, self._clock.now_s(), length_s)

    def _next_exposure(self, asked_s: float) -> tuple[int, float]:
        """Return the number and the start of the next exposure that is not lost."""
        lost = int(self._faults.take("drop") is not None)
        if self._settings.fps is None:
            return self._sequence + lost, asked_s
        beat = self._beat()
        number = beat.next(asked_s) + lost
        return number, beat.start_s(number)

    def _grab(self, timeout_s: float) -> Frame:
        asked_s = self._clock.now_s()
        if "stall" in self._faults.active:
            raise self._too_late(timeout_s, "the sensor stands still")
        if self._faults.take("stale") is not None and self._before is not None:
            return self._before
        readout_s = self._readout_s()
        number, begins_s = self._next_exposure(asked_s)
        needed_s = begins_s - asked_s + self._exposure_s + readout_s
        if not needed_s <= timeout_s:  # also True for NaN
            raise self._too_late(timeout_s, f"it takes {needed_s:g} s")
        utc = self._utc_of(begins_s)
        self._clock.sleep(begins_s + self._exposure_s / 2 - asked_s)
        exposure = self._expose(number, begins_s, utc, readout_s)
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

    def _expose_streamed(self, number: int, begins_s: float) -> Exposure | None:
        """Expose frame `number` of a stream, in the middle of its exposure. Return None if it is lost."""
        self._require_open("stream")
        if "stall" in self._faults.active or self._faults.take("drop") is not None:
            return None
        return self._expose(number, begins_s, self._utc_of(begins_s), self._readout_s())

    def _read_out_streamed(self, exposure: Exposure) -> Frame:
        if self._faults.take("stale") is not None and self._before is not None:
            return self._before
        return self._read_out(exposure)

    def _expose(self, number: int, begins_s: float, utc: datetime, readout_s: float) -> Exposure:
        """Look at the scene, now in the middle of the exposure, and draw the picture."""
        before_s = self._clock.now_s()
        surface = self._scene.surface()
        after_s = self._clock.now_s()
        reflectance = self._pictures.alter(render(self.optics, surface))
        image = self._sensor.expose(
            reflectance, self._settings.exposure_us, self._settings.gain, self._noise_of(number)
        )
        return Exposure(
            number,
            exposed_s=begins_s,
            middle_s=(before_s + after_s) / 2,
            middle_std_s=(after_s - before_s) / math.sqrt(12.0),
            utc=utc,
            surface=surface,
            image=image,
            arrives_s=begins_s + self._exposure_s + readout_s,
        )

    def _read_out(self, exposure: Exposure) -> Frame:
        """Return the frame of an exposure that arrives now, with the faults that are on now."""
        image = exposure.image
        if self._before is not None and self._pictures.frozen():
            image = self._before.image.copy()
        damaged = self._faults.take("corrupt") is not None
        if damaged:
            image[len(image) // 2 :] = 0
        self.shown = exposure.surface
        self._sequence = exposure.number + 1
        self._before = Frame(
            image=image,
            exposed_s=exposure.exposed_s,
            received_s=self._clock.now_s(),
            utc=exposure.utc,
            sequence=exposure.number,
            flags=FLAG_ERROR if damaged else 0,
            exposure_us=self._settings.exposure_us,
            gain=self._settings.gain,
            middle_s=exposure.middle_s,
            middle_std_s=exposure.middle_std_s,
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
        rate = {} if self._settings.fps is None else {"rate_hz": self._settings.fps}
        return {name: getattr(self._settings, name) for name in names} | rate

    def close(self) -> None:
        """Release the camera and end its stream; a repeated call does nothing."""
        self._open = False
        stream = self._stream
        if stream is not None:
            stream.close()

    def _stream_closed(self) -> None:
        self._stream = None

    def _noise_of(self, sequence: int) -> np.random.Generator:
        return np.random.default_rng([self._scene.seed, crc32(self.info.serial.encode()), sequence])

    def _require_free(self, step: str) -> None:
        self._require_open(step)
        if self._stream is not None:
            raise DeviceFault(
                self.info.serial,
                step,
                "no open stream",
                "a stream that takes every frame",
                "take the frame from the stream, or close it",
            )

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


def _open(settings: CameraSettings, context: OpenContext) -> SimulatedCamera:
    faults = getattr(context.environment, "faults", None)
    panel = faults[CAMERA] if isinstance(faults, RigFaults) else None
    pictures = getattr(context.environment, "picture_faults", None)
    camera = SimulatedCamera(context.name, settings, scene_of(context), context.clock, panel, pictures)
    camera.require_plugged("open")
    return camera


SPEC = DriverSpec("camera", CameraSettings, _open)
