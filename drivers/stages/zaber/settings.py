"""Rig-file settings of a stage with the Zaber ASCII protocol."""

from pydantic import Field

from drivers.stages.settings import StageSettings


class ZaberSettings(StageSettings):
    """Address and scale of a Zaber stage, in addition to the settings of all stages.

    Attributes
    ----------
    address, axis : int
        Address of the device on the line, and number of its axis.
    microsteps_per_deg : float
        Number of microsteps per degree, from the data sheet. If the stage reports its own scale, a different
        value is refused.
    """

    address: int = Field(default=1, ge=1, le=99)
    axis: int = Field(default=1, ge=1, le=9)
    microsteps_per_deg: float = Field(default=6400.0, ge=1, le=1e7)
