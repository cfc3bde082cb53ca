"""Rig-file settings of a stage on a Newport ESP301."""

from pydantic import Field

from drivers.stages.settings import StageSettings


class EspSettings(StageSettings):
    """Baud rate, axis and home search, in addition to the settings of all stages.

    Attributes
    ----------
    baud : int
        Baud rate of the serial line: 921600 for an ESP301, 19200 for an ESP300.
    axis : int
        Number of the axis on the controller.
    home_mode : int, optional
        Value of the command ``OR``, which selects the signals for the home search. The default is the mode
        stored in the controller. Mode 0 is refused, because it moves to the counter value 0 without looking
        for a signal.
    tolerance_deg : float
        Largest distance from the target, in degrees, at which the stage has arrived.
    """

    baud: int = Field(default=921_600, ge=300, le=4_000_000)
    axis: int = Field(default=1, ge=1, le=3)
    home_mode: int | None = Field(default=None, ge=1, le=6)
    tolerance_deg: float = Field(default=0.01, gt=0, le=1)
