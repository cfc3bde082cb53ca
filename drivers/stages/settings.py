"""Rig-file settings that all stages share."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings

# Plausible bounds for any stage, so that typing errors are reported before a device is opened.
ANGLE_GREATEST_DEG = 1e6
SPEED_GREATEST_DEG_S = 1e4


class StageSettings(Settings):
    """Port, limits and speed.

    Attributes
    ----------
    port : str
        Path of the serial device, ``socket://host:port``, or ``@name`` of a simulated rig's server.
    angle_min_deg, angle_max_deg : float
        Limits of travel, also written to the device. A rotary stage may have more than a turn.
    speed_deg_s : float
        Written to the device.
    reply_timeout_s : float
        Time limit for an answer.
    """

    port: str
    angle_min_deg: float = Field(ge=-ANGLE_GREATEST_DEG, le=ANGLE_GREATEST_DEG)
    angle_max_deg: float = Field(ge=-ANGLE_GREATEST_DEG, le=ANGLE_GREATEST_DEG)
    speed_deg_s: float = Field(default=10.0, gt=0, le=SPEED_GREATEST_DEG_S)
    reply_timeout_s: float = Field(default=1.0, gt=0, le=60)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.angle_min_deg >= self.angle_max_deg:
            raise ValueError("angle_min_deg must be below angle_max_deg")
        return self
