"""What a rig file says about a camera on Linux' camera interface."""

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from drivers.cameras.v4l2.find import BUS, SERIAL
from drivers.cameras.v4l2.pixels import FORMATS
from drivers.settings import Settings


class V4l2Settings(Settings):
    """Everything that decides what a grey level means must be said; nothing is left to an automatic.

    Attributes
    ----------
    device : str
        A path, ``bus:`` with what ``v4l2-ctl --list-devices`` shows in brackets, or ``serial:`` with the USB
        serial number.
    format : str
        Compressed formats are not offered: compression moves speckles.
    exposure_us : float, optional
        Left out only where the camera has no control for it.
    gain : int, optional
        In the camera's own unit; without it the gain is left as found, held, and recorded.
    controls : dict of str to int
        Further controls by the names that ``v4l2-ctl --list-ctrls`` shows. An automatic that is named here
        takes this value instead of being switched off.
    line_us : float, optional
        Duration of a line, for sensors that count their exposure in lines.
    transfer_us : float, optional
        Longest time from the end of exposure to the frame's time stamp, where this does not mark the start of
        exposure; a frame time by default.
    """

    device: str = Field(min_length=1)
    format: Literal["GREY", "Y10", "Y12", "Y16", "YUYV"] = "GREY"
    width_px: int = Field(ge=16, le=32768)
    height_px: int = Field(ge=16, le=32768)
    rate_hz: float = Field(gt=0, le=10_000)
    exposure_us: float | None = Field(default=None, gt=0)
    gain: int | None = None
    controls: dict[str, int] = Field(default_factory=dict)
    input: int = Field(default=0, ge=0, le=255)
    buffers: int = Field(default=4, ge=2, le=32)
    stride_bytes: int = Field(default=0, ge=0, le=2**20)
    line_us: float | None = Field(default=None, gt=0)
    transfer_us: float | None = Field(default=None, ge=0)

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

    @model_validator(mode="after")
    def _fits_between_frames(self) -> Self:
        if self.exposure_us is not None and self.exposure_us * self.rate_hz > 1e6:
            raise ValueError(
                f"exposure_us must not be longer than a frame ({1e6 / self.rate_hz:.0f} µs at rate_hz)"
            )
        return self
