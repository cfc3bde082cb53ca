"""Rig-file settings that all stages share."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import LONGEST_PATH, Settings

# Bounds wide enough for any stage. They reveal a typing error in the rig file before a device is opened.
ANGLE_GREATEST_DEG = 1e6
SPEED_GREATEST_DEG_S = 1e4
ACCELERATION_GREATEST_DEG_S2 = 1e6


class StageSettings(Settings):
    """Port, limits and speed of a stage, as given in the rig file.

    Attributes
    ----------
    port : str
        Path of the serial port, ``socket://host:port``, or ``@name`` for a server of the simulated rig.
    angle_min_deg, angle_max_deg : float
        Limits of travel in degrees, also written to the device. The range may be more than one turn.
    speed_deg_s : float
        Speed in degrees per second, written to the device.
    acceleration_deg_s2 : float, optional
        Acceleration and deceleration, written to the device. By default the device keeps its own value. A
        stage needs the time `speed_deg_s` / `acceleration_deg_s2` to stop.
    reply_timeout_s : float
        Longest wait for an answer of the device, in seconds.
    """

    port: str = Field(min_length=1, max_length=LONGEST_PATH)
    angle_min_deg: float = Field(ge=-ANGLE_GREATEST_DEG, le=ANGLE_GREATEST_DEG)
    angle_max_deg: float = Field(ge=-ANGLE_GREATEST_DEG, le=ANGLE_GREATEST_DEG)
    speed_deg_s: float = Field(default=10.0, gt=0, le=SPEED_GREATEST_DEG_S)
    acceleration_deg_s2: float | None = Field(default=None, gt=0, le=ACCELERATION_GREATEST_DEG_S2)
    reply_timeout_s: float = Field(default=0.25, gt=0, le=60)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.angle_min_deg >= self.angle_max_deg:
            raise ValueError("angle_min_deg must be below angle_max_deg")
        return self
