"""Settings of the guardian: the table ``[guardian]`` of a rig file."""

from pydantic import Field

from drivers.settings import Settings

# The run must read its devices this number of times within the guardian's `patience_s`.
READINGS_IN_PATIENCE = 8
# A guardian that hangs counts as dead after this fraction of `patience_s`. If it owns a line, the run ends it
# before the driver's call counts as hanging.
SILENCE_IN_PATIENCE = 0.6


class GuardianSettings(Settings):
    """Times without a sign of progress after which the guardian stops the machines."""

    # time in s while something may be moving. The lower bound allows for a busy computer. The upper bound
    # limits the distance that a machine moves unwatched.
    patience_s: float = Field(default=0.85, ge=0.3, le=5.0)
    # time in s while everything stands still
    standing_patience_s: float = Field(default=60.0, ge=5.0, le=3600.0)

    @property
    def poll_max_s(self) -> float:
        """The longest time between two readings with which the guardian sees enough progress."""
        return self.patience_s / READINGS_IN_PATIENCE

    @property
    def silence_max_s(self) -> float:
        """Time without an answer after which the guardian itself counts as dead."""
        return self.patience_s * SILENCE_IN_PATIENCE
