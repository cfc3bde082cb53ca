"""Settings of a camera through OpenCV in a rig file."""

from typing import Literal

from pydantic import Field, field_validator

from drivers.cameras.settings import FrameSettings

LAST_NUMBER = 9999
"""Largest `source` number: OpenCV adds a multiple of 100 for the backend to a camera's number."""
OWN_SETTINGS = {
    "FRAME_WIDTH": "width_px",
    "FRAME_HEIGHT": "height_px",
    "FPS": "rate_hz",
    "EXPOSURE": "exposure",
    "GAIN": "gain",
}


class OpencvCameraSettings(FrameSettings):
    """Settings of the camera in a rig file.

    Attributes
    ----------
    source : int or str
        OpenCV's number of the camera, or the address of a stream.
    exposure, gain : float, optional
        In the unit of the camera's backend; written and read back if given.
    properties : dict of str to float
        Further properties by OpenCV's names without ``CAP_PROP_``, such as ``AUTO_EXPOSURE``.
    channel : str
        Channel of a colour picture that gives the grey levels.
    buffered_frames : int
        Number of frames that camera, kernel and OpenCV may buffer; `grab` discards as many.
    """

    source: int | str
    exposure: float | None = None
    gain: float | None = None
    properties: dict[str, float] = Field(default_factory=dict)
    channel: Literal["grey", "green"] = "grey"
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
            raise ValueError(f"must not hold {name}: say it by {OWN_SETTINGS[name]}")
        return properties

    @property
    def bits(self) -> int:
        """Significant bits of a pixel: OpenCV gives bytes."""
        return 8
