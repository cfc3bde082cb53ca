"""What a rig file says about a camera through OpenCV."""

from typing import Literal

from pydantic import Field, field_validator

from drivers.cameras.settings import FrameSettings

LAST_NUMBER = 9999
"""OpenCV adds some thousands for the backend to a camera's own number."""
OWN_SETTINGS = {
    "FRAME_WIDTH": "width_px",
    "FRAME_HEIGHT": "height_px",
    "FPS": "rate_hz",
    "EXPOSURE": "exposure",
    "GAIN": "gain",
}


class OpencvCameraSettings(FrameSettings):
    """What a rig file says about the camera.

    Attributes
    ----------
    source : int or str
        OpenCV's number of the camera, or the address of a stream.
    exposure, gain : float, optional
        In whatever unit the camera's backend has; written and read back if given.
    properties : dict of str to float
        Further properties by OpenCV's names without ``CAP_PROP_``, such as ``AUTO_EXPOSURE``.
    channel : str
        Which grey levels are taken of a colour picture.
    buffered_frames : int
        How many frames camera, kernel and OpenCV may hold back: so many are thrown away before one counts.
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
