"""What a rig file says about a stage in the Zaber ASCII protocol."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings


class ZaberSettings(Settings):
    """Port, axis, scale, limits and speed.

    Attributes
    ----------
    port : str
        Path of the serial device, ``socket://host:port``, or ``@name`` of a simulated rig's server.
    address, axis : int
        The device in the chain and its axis.
    microsteps_per_deg : float
        As the data sheet says; a stage that knows its own is asked, and another value is refused.
    angle_min_deg, angle_max_deg : float
        Limits of travel, also written to the stage. A rotary stage may have more than a turn.
    speed_deg_s : float
        Written to the stage.
    reply_timeout_s : float
        How long an answer may take.
    """

    port: str
    address: int = Field(default=1, ge=1, le=99)
    axis: int = Field(default=1, ge=1, le=9)
    microsteps_per_deg: float = Field(default=6400.0, gt=0)
    angle_min_deg: float
    angle_max_deg: float
    speed_deg_s: float = Field(default=10.0, gt=0)
    reply_timeout_s: float = Field(default=1.0, gt=0, le=60)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.angle_min_deg >= self.angle_max_deg:
            raise ValueError("angle_min_deg must be below angle_max_deg")
        return self
