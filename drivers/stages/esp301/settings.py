"""Rig-file settings of a stage on a Newport ESP301."""

from pydantic import Field

from drivers.stages.settings import StageSettings


class EspSettings(StageSettings):
    """Line, axis and home search, in addition to the settings of all stages.

    Attributes
    ----------
    baud : int
        921600 on an ESP301; an ESP300 has 19200.
    axis : int
    home_mode : int, optional
        The value of ``OR``: the signals that the home search looks for. By default the controller's own mode.
        0 is refused: this home search looks for no signal and moves to the counter value 0.
    tolerance_deg : float
        A stage within this distance of its target has arrived.
    """

    baud: int = Field(default=921_600, ge=300, le=4_000_000)
    axis: int = Field(default=1, ge=1, le=3)
    home_mode: int | None = Field(default=None, ge=1, le=6)
    tolerance_deg: float = Field(default=0.01, gt=0, le=1)
