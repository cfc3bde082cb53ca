"""Rig-file settings of a camera that is opened through OpenCV."""

from typing import Literal

from pydantic import Field, field_validator

from drivers.cameras.settings import FrameSettings

LAST_NUMBER = 9999
"""Largest `source` number. A number is that of the camera plus a multiple of 100 that selects OpenCV's
backend."""
OWN_SETTINGS = {
    "FRAME_WIDTH": "width_px",
    "FRAME_HEIGHT": "height_px",
    "FPS": "rate_hz",
    "EXPOSURE": "exposure",
    "GAIN": "gain",
}


class OpencvCameraSettings(FrameSettings):
    """Settings of a camera that is opened through OpenCV, as given in the rig file."""

    source: int | str  # OpenCV's number of the camera, or the address of a stream
    # exposure and gain in the unit of OpenCV's backend. If given, the driver writes each value and reads it
    # back.
    exposure: float | None = None
    gain: float | None = None
    # further OpenCV properties, named without ``CAP_PROP_``, for example ``AUTO_EXPOSURE``
    properties: dict[str, float] = Field(default_factory=dict)
    # source of the grey levels in a colour picture: ``grey`` weights all channels, ``green`` takes the green
    # channel only
    channel: Literal["grey", "green"] = "grey"
    # number of frames that camera, kernel and OpenCV may buffer. `grab` discards this number plus one.
    buffered_frames: int = Field(default=5, ge=0, le=64)

    @field_validator("source")
    @classmethod
    def _is_a_number_or_an_address(cls, source: int | str) -> int | str:
        if source == "" or (isinstance(source, int) and not 0 <= source <= LAST_NUMBER):
            raise ValueError(f"a number of OpenCV's from 0 to {LAST_NUMBER} or an address is expected")
        return source

    @field_validator("properties")
    @classmethod
    def _says_nothing_twice(cls, properties: dict[str, float]) -> dict[str, float]:
        for name in OWN_SETTINGS.keys() & properties.keys():
            raise ValueError(f"must not hold {name}: use the setting {OWN_SETTINGS[name]}")
        return properties

    @property
    def bits(self) -> int:
        """Number of significant bits per pixel. OpenCV delivers 8 bits."""
        return 8
