"""The errors that can end a run; each message is one sentence that ends with the remedy."""


class RigError(Exception):
    """The experiment cannot go on.

    Parameters
    ----------
    step : str
        The step of the protocol, or the file, where the error occurred.
    expected, got : str
        What should have happened, and what happened.
    remedy : str
        What to do about it.
    """

    def __init__(self, step: str, expected: str, got: str, remedy: str) -> None:
        super().__init__(step, expected, got, remedy)
        self.step, self.expected, self.got, self.remedy = step, expected, got, remedy

    def __str__(self) -> str:
        return f"{self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class ProtocolError(RigError):
    """The protocol cannot be carried out on this rig or with this specimen."""


class LimitViolation(RigError):
    """Load or displacement left the limits the protocol declares."""


class SpecimenBroken(RigError):
    """The load fell by more than the protocol allows while the specimen was stretched."""


class SettleTimeout(RigError):
    """Load, displacement or angle did not settle before the deadline."""


class RecordingError(RigError):
    """A run file cannot be created or written."""


class Aborted(RigError):
    """A person or a signal asked for the end of the run."""
