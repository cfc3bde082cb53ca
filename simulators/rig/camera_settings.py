"""Settings of a simulated camera in a rig file."""

from dataclasses import fields
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from drivers.settings import Settings
from simulators.scene.optics import PinholeCamera
from simulators.scene.sensor import Sensor

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
    fast_ppm: float = Field(
        default=0.0,
        ge=-1000,
        le=1000,
        description="with fps, how much faster the camera's own clock runs: its beat rolls past the others'",
    )
    delay_us: float = Field(
        default=0.0, ge=0, le=1e6, description="time by which each exposure starts later than it is meant to"
    )
    jitter_us: float = Field(
        default=0.0, ge=0, le=1e6, description="width of the uniform distribution of a further delay"
    )
    stamp: Literal["true", "meant"] = Field(
        default="true", description="whether the frame's times know the delays, or tell what was meant"
    )
    stamp_std_us: float = Field(
        default=0.0, ge=0, le=1e6, description="standard deviation that the frame states for its times"
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
        if self.fps is not None and (self.exposure_us + self.jitter_us) * self.fps > 1e6:
            raise ValueError(
                f"exposure_us and jitter_us must fit into a frame ({1e6 / self.fps:.0f} µs at fps)"
            )
        if self.fps is None and self.fast_ppm:
            raise ValueError("fast_ppm needs fps: a camera that exposes when it is asked has no beat")
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
