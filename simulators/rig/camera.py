"""A simulated camera that renders the specimen as seen from the camera's position."""

import threading
from dataclasses import fields
from typing import Literal
from zlib import crc32

import numpy as np
from pydantic import Field, model_validator

from drivers.clock import Clock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, Frame, OpenContext, Setting
from drivers.registry import DriverSpec
from drivers.settings import Settings
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
            return self._grab(timeout_s)

    def _grab(self, timeout_s: float) -> Frame:
        self._require_open("grab")
        exposure_s = self._settings.exposure_us * 1e-6
        readout_s = self._settings.readout_us * 1e-6 + float(self._faults.take("delay") or 0)
        stalled = "stall" in self._faults.active
        if stalled or not exposure_s + readout_s <= timeout_s:  # also True for NaN
            self._clock.sleep(timeout_s)
            reason = "the sensor stands still" if stalled else f"it takes {exposure_s + readout_s:g} s"
            raise DeviceTimeout(
                self.info.serial,
                "grab",
                f"a frame within {timeout_s:g} s",
                f"none: {reason}",
                "shorten the exposure or allow more time, and check the camera's trigger and power",
            )
        if self._faults.take("stale") is not None and self._before is not None:
            return self._before
        if self._faults.take("drop") is not None:
            self._sequence += 1
        frame = self._expose(exposure_s, readout_s)
        self._sequence += 1
        self._before = frame
        return frame

    def _expose(self, exposure_s: float, readout_s: float) -> Frame:
        exposed_s, utc = self._clock.now_s(), self._clock.utc()
        self._clock.sleep(exposure_s / 2)
        self.shown = self._scene.surface()
        reflectance = self._pictures.alter(render(self.optics, self.shown))
        self._clock.sleep(exposure_s / 2 + readout_s)
        image = self._sensor.expose(
            reflectance, self._settings.exposure_us, self._settings.gain, self._noise_of(self._sequence)
        )
        if self._before is not None and self._pictures.frozen():
            image = self._before.image.copy()
        damaged = self._faults.take("corrupt") is not None
        if damaged:
            image[len(image) // 2 :] = 0
        return Frame(
            image=image,
            exposed_s=exposed_s,
            received_s=self._clock.now_s(),
            utc=utc,
            sequence=self._sequence,
            flags=FLAG_ERROR if damaged else 0,
            exposure_us=self._settings.exposure_us,
            gain=self._settings.gain,
        )

    def read_settings(self) -> dict[str, Setting]:
        """Return the settings of sensor and readout; raise the errors of `grab` for a camera that is gone."""
        self._require_open("read settings")
        names = ("width_px", "height_px", "bits", "exposure_us", "gain", "readout_us")
        return {name: getattr(self._settings, name) for name in names}

    def close(self) -> None:
        """Release the camera; a repeated call does nothing."""
        self._open = False

    def _noise_of(self, sequence: int) -> np.random.Generator:
        return np.random.default_rng([self._scene.seed, crc32(self.info.serial.encode()), sequence])

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
