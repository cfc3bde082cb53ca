"""Rig-file settings of a camera on the camera interface of Linux (V4L2)."""

from typing import Literal

from pydantic import Field, field_validator

from drivers.cameras.settings import DatedFrameSettings
from drivers.cameras.v4l2.find import BUS, SERIAL
from drivers.cameras.v4l2.pixels import FORMATS


class V4l2Settings(DatedFrameSettings):
    """Settings of a camera. The driver switches off the automatic controls that change grey levels."""

    # path of the device node; or ``bus:`` and the text in brackets from ``v4l2-ctl --list-devices``; or
    # ``serial:`` and the USB serial number
    device: str = Field(min_length=1)
    # pixel format. Compressed formats are not supported, because compression distorts speckles.
    format: Literal["GREY", "Y10", "Y12", "Y16", "YUYV"] = "GREY"
    # gain in the unit of the camera. Without this setting, the driver does not change the gain, but verifies
    # and records its value.
    gain: int | None = None
    # further controls, named as in ``v4l2-ctl --list-ctrls``, and their values. An automatic control that is
    # named in `controls` gets the given value and is not switched off.
    controls: dict[str, int] = Field(default_factory=dict)
    input: int = Field(default=0, ge=0, le=255)
    buffers: int = Field(default=4, ge=2, le=32)
    stride_bytes: int = Field(default=0, ge=0, le=2**20)
    # duration of one sensor line in µs, required if the sensor counts its exposure time in lines
    line_us: float | None = Field(default=None, gt=0)

    @property
    def bits(self) -> int:
        """Number of significant bits per pixel, used to estimate the amount of data of a run."""
        return FORMATS[self.format].bits

    @field_validator("device")
    @classmethod
    def _names_something(cls, device: str) -> str:
        if device in (BUS, SERIAL):
            raise ValueError(f"a name is expected after {device!r}")
        return device
