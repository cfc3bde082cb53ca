"""What a rig file says about a stage in the Zaber ASCII protocol."""

from pydantic import Field

from drivers.stages.settings import StageSettings


class ZaberSettings(StageSettings):
    """Address and scale, besides what all stages have.

    Attributes
    ----------
    address, axis : int
        The device in the chain and its axis.
    microsteps_per_deg : float
        As the data sheet says; a stage that knows its own is asked, and another value is refused.
    """

    address: int = Field(default=1, ge=1, le=99)
    axis: int = Field(default=1, ge=1, le=9)
    microsteps_per_deg: float = Field(default=6400.0, ge=1, le=1e7)
