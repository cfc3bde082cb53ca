"""Rig-file settings of a GigE Vision or USB3 Vision camera."""

from typing import Literal

from pydantic import Field

from drivers.cameras.settings import DatedFrameSettings

BITS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono14": 14, "Mono16": 16}


class AravisSettings(DatedFrameSettings):
    """Settings of a camera. The driver switches off the automatic controls that change grey levels."""

    # network address of the camera, or its identifier as printed by ``arv-tool-0.8`` (``Maker-SERIAL``)
    camera: str = Field(min_length=1)
    # GenICam pixel format. Only unpacked grey-level formats are supported.
    format: Literal["Mono8", "Mono10", "Mono12", "Mono14", "Mono16"] = "Mono8"
    # offset of the picture on the sensor
    offset_x_px: int = Field(default=0, ge=0)
    offset_y_px: int = Field(default=0, ge=0)
    exposure_us: float = Field(gt=0)
    # gain in the unit of the camera (often dB). Without this setting, the driver does not change the gain and
    # records its value.
    gain: float | None = None
    # further GenICam features of type string or enumeration, and their values. An automatic control that is
    # named in `features` gets the given value and is not switched off.
    features: dict[str, str] = Field(default_factory=dict)
    buffers: int = Field(default=8, ge=2, le=64)

    @property
    def bits(self) -> int:
        """Number of significant bits per pixel, used to estimate the amount of data of a run."""
        return BITS[self.format]
