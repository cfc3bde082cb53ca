"""Rig-file settings of the frames, common to all cameras of this project."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings


class FrameSettings(Settings):
    """Size and rate of the frames. The driver writes both to the camera and reads them back."""

    width_px: int = Field(ge=16, le=32768)
    height_px: int = Field(ge=16, le=32768)
    rate_hz: float = Field(gt=0, le=10_000)


class DatedFrameSettings(FrameSettings):
    """Frame settings of cameras that deliver timestamps."""

    # exposure time in µs. Omit this setting only if the camera has no exposure control.
    exposure_us: float | None = Field(default=None, gt=0)
    # longest time, in µs, from the end of exposure to the timestamp of the frame. The default is one frame
    # time. The setting has no effect if the timestamp marks the start of exposure.
    transfer_us: float | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _fits_between_frames(self) -> Self:
        if self.exposure_us is not None and self.exposure_us * self.rate_hz > 1e6:
            raise ValueError(
                f"exposure_us must not be longer than a frame ({1e6 / self.rate_hz:.0f} µs at rate_hz)"
            )
        return self
