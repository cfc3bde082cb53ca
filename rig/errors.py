"""The errors that can end a run. Each message is one sentence; its last part tells the user what to do."""


class RigError(Exception):
    """The experiment cannot start or continue.

    Parameters
    ----------
    step : str
        The step of the protocol, or the file, where the error occurred.
    expected, got : str
        The expected result, and the actual result.
    remedy : str
        How the user can correct the error.
    """

    def __init__(self, step: str, expected: str, got: str, remedy: str) -> None:
        super().__init__(step, expected, got, remedy)
        self.step, self.expected, self.got, self.remedy = step, expected, got, remedy

    def __str__(self) -> str:
        return f"{self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class ProtocolError(RigError):
    """The protocol cannot be carried out on this rig or with this specimen."""


class LimitViolation(RigError):
    """The load or the displacement is beyond a limit of the protocol."""


class ImplausibleReading(LimitViolation):
    """Load and displacement do not agree, so a reading is probably wrong."""


class InterlockOpen(LimitViolation):
    """The value of an interlock is out of bounds, so the run cannot start or continue."""


class SpecimenBroken(RigError):
    """The load fell by more than the protocol allows, so the specimen probably broke."""


class SettleTimeout(RigError):
    """The load, the displacement or the angle did not settle before the deadline."""


class BadImage(RigError):
    """An image violates a limit, and `images.on_bad_image` of the protocol is "stop"."""


class RecordingError(RigError):
    """A run file cannot be created or written."""


class Aborted(RigError):
    """The run ended early, usually because a signal or a call of `Engine.abort` requested the end."""


class GaugeNotValid(RigError):
    """A live gauge that a limit, the end of a phase or a control needs has no valid strain."""
