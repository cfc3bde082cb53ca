"""What a rig file says about the frames of any camera of ours."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings


class FrameSettings(Settings):
    """Size and rate of the frames; they are set and read back."""

    width_px: int = Field(ge=16, le=32768)
    height_px: int = Field(ge=16, le=32768)
    rate_hz: float = Field(gt=0, le=10_000)


class DatedFrameSettings(FrameSettings):
    """The same of a camera that can tell when a frame was exposed.

    Attributes
    ----------
    exposure_us : float, optional
        Left out only where the camera has no control for it.
    transfer_us : float, optional
        Longest time from the end of exposure to the frame's time stamp, where this does not mark the start of
        exposure; a frame time by default.
    """

    exposure_us: float | None = Field(default=None, gt=0)
    transfer_us: float | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _fits_between_frames(self) -> Self:
        if self.exposure_us is not None and self.exposure_us * self.rate_hz > 1e6:
            raise ValueError(
                f"exposure_us must not be longer than a frame ({1e6 / self.rate_hz:.0f} µs at rate_hz)"
            )
        return self
