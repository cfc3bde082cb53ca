"""What a rig file says about a GigE Vision or USB3 Vision camera."""

from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

BITS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono14": 14, "Mono16": 16}


class AravisSettings(Settings):
    """Everything that decides what a grey level means must be said; automatics are switched off.

    Attributes
    ----------
    camera : str
        Address, or identifier as ``arv-tool-0.8`` lists it (``Maker-SERIAL``).
    format : str
        Unpacked grey levels.
    offset_x_px, offset_y_px : int
        Of the picture on the sensor.
    gain : float, optional
        In the camera's own unit (often dB); without it the gain is left as found, and recorded.
    features : dict of str to str
        Further GenICam features that take text or a choice. An automatic that is named here takes this value
        instead of being switched off.
    transfer_us : float, optional
        Longest time from the end of exposure to the arrival of the frame's first packet; a frame time by
        default.
    """

    camera: str = Field(min_length=1)
    format: Literal["Mono8", "Mono10", "Mono12", "Mono14", "Mono16"] = "Mono8"
    width_px: int = Field(ge=16, le=32768)
    height_px: int = Field(ge=16, le=32768)
    offset_x_px: int = Field(default=0, ge=0)
    offset_y_px: int = Field(default=0, ge=0)
    rate_hz: float = Field(gt=0, le=10_000)
    exposure_us: float = Field(gt=0)
    gain: float | None = None
    features: dict[str, str] = Field(default_factory=dict)
    buffers: int = Field(default=8, ge=2, le=64)
    transfer_us: float | None = Field(default=None, ge=0)

    @property
    def bits(self) -> int:
        """Significant bits of a pixel; a plan tells from them how large a run will be."""
        return BITS[self.format]

    @model_validator(mode="after")
    def _fits_between_frames(self) -> Self:
        if self.exposure_us * self.rate_hz > 1e6:
            raise ValueError(
                f"exposure_us must not be longer than a frame ({1e6 / self.rate_hz:.0f} µs at rate_hz)"
            )
        return self
