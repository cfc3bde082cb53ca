"""What a rig file says about a stage on a Newport ESP301."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings


class EspSettings(Settings):
    """Port, axis, limits and speed.

    Attributes
    ----------
    port : str
        Path of the serial device, ``socket://host:port``, or ``@name`` of a simulated rig's server.
    baud : int
        921600 on an ESP301; an ESP300 has 19200.
    axis : int
    angle_min_deg, angle_max_deg : float
        Limits of travel, also written to the controller.
    speed_deg_s : float
        Written to the controller.
    home_mode : int, optional
        The value of ``OR``: which signals the home search looks for; the controller's own without one.
    tolerance_deg : float
        A stage that stands so near its target has arrived.
    reply_timeout_s : float
        How long an answer may take.
    """

    port: str
    baud: int = Field(default=921_600, ge=300)
    axis: int = Field(default=1, ge=1, le=3)
    angle_min_deg: float
    angle_max_deg: float
    speed_deg_s: float = Field(default=10.0, gt=0)
    home_mode: int | None = Field(default=None, ge=0, le=6)
    tolerance_deg: float = Field(default=0.01, gt=0)
    reply_timeout_s: float = Field(default=1.0, gt=0, le=60)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.angle_min_deg >= self.angle_max_deg:
            raise ValueError("angle_min_deg must be below angle_max_deg")
        return self
