"""What can go wrong with a device, said in one sentence that a technician can act on."""


class DeviceError(Exception):
    """A device did not do what was asked.

    Parameters
    ----------
    device : str
        The device as the rig file names it, with its port or address.
    step : str
        What was being done.
    expected, got : str
        What should have happened, and what did.
    remedy : str
        What to do about it.
    """

    def __init__(self, device: str, step: str, expected: str, got: str, remedy: str) -> None:
        # The arguments are kept as they are, so that an error survives the way back from another process.
        super().__init__(device, step, expected, got, remedy)
        self.device, self.step = device, step
        self.expected, self.got, self.remedy = expected, got, remedy

    def __str__(self) -> str:
        return f"{self.device}: {self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class LinkLost(DeviceError):
    """The connection is gone or can no longer be trusted."""


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
        One sentence each: where, what was expected, what was found.
    """

    def __init__(self, source: str, mistakes: list[str]) -> None:
        self.source = source
        self.mistakes = mistakes
        count = "1 mistake" if len(mistakes) == 1 else f"{len(mistakes)} mistakes"
        super().__init__("\n".join([f"{source}: {count}", *(f"  {m}" for m in mistakes)]))
