"""What a rig file says about a camera on Linux' camera interface."""

from typing import Literal

from pydantic import Field, field_validator

from drivers.cameras.settings import DatedFrameSettings
from drivers.cameras.v4l2.find import BUS, SERIAL
from drivers.cameras.v4l2.pixels import FORMATS


class V4l2Settings(DatedFrameSettings):
    """Everything that decides what a grey level means must be said; nothing is left to an automatic.

    Attributes
    ----------
    device : str
        A path, ``bus:`` with what ``v4l2-ctl --list-devices`` shows in brackets, or ``serial:`` with the USB
        serial number.
    format : str
        Compressed formats are not offered: compression moves speckles.
    gain : int, optional
        In the camera's own unit; without it the gain is left as found, held, and recorded.
    controls : dict of str to int
        Further controls by the names that ``v4l2-ctl --list-ctrls`` shows. An automatic that is named here
        takes this value instead of being switched off.
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
        """Significant bits of a pixel; a plan tells from them how large a run will be."""
        return FORMATS[self.format].bits

    @field_validator("device")
    @classmethod
    def _names_something(cls, device: str) -> str:
        if device in (BUS, SERIAL):
            raise ValueError(f"a name is expected after {device!r}")
        return device
