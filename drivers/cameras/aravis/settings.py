"""What a rig file says about a GigE Vision or USB3 Vision camera."""

from typing import Literal

from pydantic import Field

from drivers.cameras.settings import DatedFrameSettings

BITS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono14": 14, "Mono16": 16}


class AravisSettings(DatedFrameSettings):
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
    """

    camera: str = Field(min_length=1)
    format: Literal["Mono8", "Mono10", "Mono12", "Mono14", "Mono16"] = "Mono8"
    offset_x_px: int = Field(default=0, ge=0)
    offset_y_px: int = Field(default=0, ge=0)
    exposure_us: float = Field(gt=0)
    gain: float | None = None
    features: dict[str, str] = Field(default_factory=dict)
    buffers: int = Field(default=8, ge=2, le=64)

    @property
    def bits(self) -> int:
        """Significant bits of a pixel; a plan tells from them how large a run will be."""
        return BITS[self.format]
