"""Errors of devices. Each message is one sentence that tells a technician what to do."""


class DeviceError(Exception):
    """A device did not execute a command or request.

    Parameters
    ----------
    device : str
        The device as the rig file names it, with its port or address.
    step : str
        The action that failed.
    expected, got : str
        The expected and the actual result.
    remedy : str
        What the user can do.
    """

    def __init__(self, device: str, step: str, expected: str, got: str, remedy: str) -> None:
        # Pass all arguments to the base class, so that the error can be pickled between processes.
        super().__init__(device, step, expected, got, remedy)
        self.device, self.step = device, step
        self.expected, self.got, self.remedy = expected, got, remedy

    def __str__(self) -> str:
        return f"{self.device}: {self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class LinkLost(DeviceError):
    """The connection is lost or no longer reliable."""


class DeviceTimeout(DeviceError):
    """The device did not answer, or did not finish, before the deadline."""


class DeviceFault(DeviceError):
    """The device answered and reported a fault, or refused the command."""


class ConfigurationError(Exception):
    """A file written by a person has mistakes; all of them are listed.

    Parameters
    ----------
    source : str
        The file.
    mistakes : sequence of str
        One sentence per mistake: the place, the expected value and the actual value.
    """

    def __init__(self, source: str, mistakes: list[str]) -> None:
        self.source = source
        self.mistakes = mistakes
        count = "1 mistake" if len(mistakes) == 1 else f"{len(mistakes)} mistakes"
        super().__init__("\n".join([f"{source}: {count}", *(f"  {m}" for m in mistakes)]))
