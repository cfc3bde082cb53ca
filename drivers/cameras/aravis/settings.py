"""Settings of a GigE Vision or USB3 Vision camera in a rig file."""

from typing import Literal

from pydantic import Field

from drivers.cameras.settings import DatedFrameSettings

BITS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono14": 14, "Mono16": 16}


class AravisSettings(DatedFrameSettings):
    """All settings that affect grey levels are required; automatic controls are switched off.

    Attributes
    ----------
    camera : str
        Address, or identifier as listed by ``arv-tool-0.8`` (``Maker-SERIAL``).
    format : str
        Unpacked grey levels.
    offset_x_px, offset_y_px : int
        Offset of the picture on the sensor.
    gain : float, optional
        Gain in the unit of the camera (often dB). Without this setting the gain stays unchanged and is
        recorded.
    features : dict of str to str
        Further GenICam features of type string or enumeration. An automatic control that is named here gets
        this value instead of being switched off.
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
        """Significant bits of a pixel; a plan computes the size of a run from this number."""
        return BITS[self.format]
