"""One axis of a Newport ESP301: questions, commands, and the errors that only a queue tells of."""

from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages.esp301.port import EspPort
from drivers.stages.esp301.protocol import QUEUE_DEPTH, QueuedError, read_error
from drivers.stages.esp301.reference import Reference

T = TypeVar("T")


class EspAxis:
    """An axis, and what its errors mean for its reference position.

    Parameters
    ----------
    port : EspPort
    number : int
        1 to 3.
    reference : Reference
        Is told of every error after which motion has failed.
    """

    def __init__(self, port: EspPort, number: int, reference: Reference) -> None:
        self._port = port
        self.number = number
        self._reference = reference

    def ask(self, question: str, read: Callable[[str], T]) -> T:
        """Ask what may be asked twice."""
        return self._port.ask(f"{self.number}{question}", read)

    def tell(self, command: str, step: str, permit: Callable[[], None] | None = None) -> None:
        """Send a command once, if `permit` lets it; `DeviceFault` if the controller refused it."""
        self._port.send(f"{self.number}{command}", permit)
        try:
            errors = self.take_errors(after_command=True)
        except DeviceTimeout:
            return  # whether it was obeyed is seen by what the stage does
        if refused := [str(error) for error in errors if error.axis in (0, self.number)]:
            raise DeviceFault(
                self._port.name,
                step,
                "acceptance",
                "; ".join(refused),
                "see appendix A of the controller's manual",
            )

    def take_errors(self, *, after_command: bool = False) -> list[QueuedError]:
        """Take out all errors, and note those after which motion has failed: nobody can read them again."""
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
            # the answer that is missing may have been the error that ended a home search
            self._reference.break_off()
            return self._port.ask("TB?", read_error)
