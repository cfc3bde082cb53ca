"""Exception classes. Each message about a device is one sentence that tells a technician what to do."""


class DeviceError(Exception):
    """A device did not execute a command or request.

    Parameters
    ----------
    device : str
        The device's name in the rig file, with its port or address.
    step : str
        The action that failed.
    expected, got : str
        The expected and the actual result.
    remedy : str
        Action that the user can take against the error.
    """

    def __init__(self, device: str, step: str, expected: str, got: str, remedy: str) -> None:
        # Pass all arguments to the base class, so that the error can be pickled between processes.
        super().__init__(device, step, expected, got, remedy)
        self.device, self.step = device, step
        self.expected, self.got, self.remedy = expected, got, remedy

    def __str__(self) -> str:
        return f"{self.device}: {self.step}: expected {self.expected}, got {self.got}; {self.remedy}"


class LinkLost(DeviceError):
    """The connection to the device is lost or no longer reliable."""


class DeviceTimeout(DeviceError):
    """The device did not answer, or did not finish, before the deadline."""


class DeviceFault(DeviceError):
    """The device answered and reported a fault, or refused the command."""


class ConfigurationError(Exception):
    """A file written by a person has mistakes. The message lists all mistakes.

    Parameters
    ----------
    source : str
        Name of the file that has the mistakes.
    mistakes : sequence of str
        One sentence per mistake, with its place in the file, the expected value and the actual value.
    """

    def __init__(self, source: str, mistakes: list[str]) -> None:
        self.source = source
        self.mistakes = mistakes
        if len(mistakes) == 1:
            super().__init__(f"{source}: {mistakes[0]}")
        else:
            lines = [f"{source}: {len(mistakes)} mistakes", *(f"  {mistake}" for mistake in mistakes)]
            super().__init__("\n".join(lines))
