"""Settings of a camera on the camera interface of Linux in a rig file."""

from typing import Literal

from pydantic import Field, field_validator

from drivers.cameras.settings import DatedFrameSettings
from drivers.cameras.v4l2.find import BUS, SERIAL
from drivers.cameras.v4l2.pixels import FORMATS


class V4l2Settings(DatedFrameSettings):
    """All settings that affect grey levels are required; automatic controls are switched off.

    Attributes
    ----------
    device : str
        A path, ``bus:`` and the text in brackets from ``v4l2-ctl --list-devices``, or ``serial:`` and the USB
        serial number.
    format : str
        Pixel format. Compressed formats are not supported: compression distorts speckles.
    gain : int, optional
        Gain in the unit of the camera. Without this setting the gain stays unchanged, is verified and
        recorded.
    controls : dict of str to int
        Further controls by their names in ``v4l2-ctl --list-ctrls``. An automatic control that is named here
        gets this value instead of being switched off.
    line_us : float, optional
        Duration of a line, for sensors that count their exposure in lines.
    """

    device: str = Field(min_length=1)
    format: Literal["GREY", "Y10", "Y12", "Y16", "YUYV"] = "GREY"
    gain: int | None = None
    controls: dict[str, int] = Field(default_factory=dict)
    input: int = Field(default=0, ge=0, le=255)
    buffers: int = Field(default=4, ge=2, le=32)
    stride_bytes: int = Field(default=0, ge=0, le=2**20)
    line_us: float | None = Field(default=None, gt=0)

    @property
    def bits(self) -> int:
        """Significant bits of a pixel; a plan computes the size of a run from this number."""
        return FORMATS[self.format].bits

    @field_validator("device")
    @classmethod
    def _names_something(cls, device: str) -> str:
        if device in (BUS, SERIAL):
            raise ValueError(f"a name is expected after {device!r}")
        return device
