"""One axis of a Newport ESP301: questions, commands, and the error queue."""

from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages.esp301.port import EspPort
from drivers.stages.esp301.protocol import QUEUE_DEPTH, QueuedError, read_error
from drivers.stages.esp301.reference import HomeReference

T = TypeVar("T")


class EspAxis:
    """One axis of the controller, whose errors are recorded, because an error can make the reference invalid.

    `number` is the number of the axis on the controller, 1 to 3. `reference` is the object that records every
    error that means a failed motion.
    """

    def __init__(self, port: EspPort, number: int, reference: HomeReference) -> None:
        self._port = port
        self.number = number
        self._reference = reference

    def ask(self, question: str, read: Callable[[str], T]) -> T:
        """Ask a question, which may be repeated, and return the answer."""
        return self._port.ask(f"{self.number}{question}", read)

    def tell(self, command: str, step: str, permit: Callable[[], None] | None = None) -> None:
        """Send a command once. Raise `DeviceFault` if the controller refuses the command."""
        self._port.send(f"{self.number}{command}", permit)
        try:
            errors = self.take_errors(after_command=True)
        except DeviceTimeout:
            return  # the next reading of the stage's state shows whether the command was executed
        if refused := [str(error) for error in errors if error.axis in (0, self.number)]:
            raise DeviceFault(
                self._port.name,
                step,
                "acceptance",
                "; ".join(refused),
                "see appendix A of the controller's manual",
            )

    def take_errors(self, *, after_command: bool = False) -> list[QueuedError]:
        """Return all errors from the error queue. Record errors that mean a failed motion in the reference.

        Reading an error removes it from the queue. If `after_command` is True, an error that may only mean a
        refused command is not recorded.
        """
        errors = []
        for _ in range(QUEUE_DEPTH + 1):
            error = self._oldest_error()
            if error.code == 0:
                break
            errors.append(error)
            if error.fails(self.number) and not (after_command and error.may_refuse(self.number)):
                self._reference.fail(str(error))
        return errors

    def _oldest_error(self) -> QueuedError:
        try:
            return self._port.ask("TB?", read_error, attempts=1)
        except DeviceTimeout:
            # the reference may be invalid, because the lost answer may contain the error that ended a home
            # search
            self._reference.break_off()
            return self._port.ask("TB?", read_error)
