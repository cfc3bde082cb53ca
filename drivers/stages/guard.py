"""The guard of a rotation stage owns the line, passes the driver's messages on, and can stop the stage."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.lines.addresses import shared_line
from drivers.lines.channel import CHANNEL_ERRORS, Channel, cannot_open, open_channel
from drivers.lines.relay import Relay, whole_lines
from drivers.lines.stop_deadline import STOP_TIMES, StopDeadline
from drivers.registry import GuardSpec
from drivers.stages.port import StagePort
from drivers.stages.settings import StageSettings

P = TypeVar("P", bound=StagePort)


@dataclass(frozen=True)
class StageTalk(Generic[P]):
    """Functions and settings with which a guard sends messages to a stage."""

    baud: int
    ends: bytes  # the bytes that can end a message to the stage. Each byte alone ends a message.
    # ``open_port(name, channel, reply_timeout_s)`` returns a port on an open channel
    open_port: Callable[[str, Channel, float], P]
    # ``stop(port, answer_s)`` commands a stop once. The function returns an empty text if the stage stands
    # still, otherwise the reason why this is not certain.
    stop: Callable[[P, float], str]
    # ``identity(port, answer_s)`` returns a text that identifies the stage, such as its serial number
    identity: Callable[[P, float], str]


class StageGuard(Generic[P]):
    """A `Guard` that owns the line to a stage. The constructor connects to the stage.

    Raise `DeviceError` if the line cannot be opened, or the stage does not answer.
    """

    def __init__(self, settings: StageSettings, context: OpenContext, talk: StageTalk[P]) -> None:
        self._url = settings.port
        self._name = f"{context.name} ({self._url})"
        self._clock = context.clock
        self._talk = talk
        answer_s = STOP_TIMES.answer_s
        self._answer_s = min(settings.reply_timeout_s, answer_s)
        self._line = Relay(lambda: open_channel(self._url, talk.baud, answer_s), whole_lines(talk.ends))
        self._port: P | None = None
        try:
            self._identity = talk.identity(self._opened(), self._answer_s)
            self._release_port()
            self._line.begin()
        except BaseException:
            self.close()
            raise
        self.relay = self._line.address

    def check(self) -> None:
        """Do nothing, because the driver's messages on the same line already show that the line works."""

    def stop(self) -> None:
        """Take over the line and stop the stage. Raise `DeviceTimeout` if the stage does not report
        standstill."""
        self._line.take_over()
        deadline = StopDeadline(self._clock, STOP_TIMES.deadline_s)
        got, proven = "silence", True
        while not deadline.passed:
            try:
                port = self._opened()
                if not (got := self._talk.stop(port, self._answer_s) or self._stranger(port, proven)):
                    return
            except LinkLost as lost:
                got, proven = lost.got, False
                self._release_port()
                self._line.drop_channel()
            except DeviceError as error:
                got = error.got
            self._clock.sleep(STOP_TIMES.poll_s)
        raise DeviceTimeout(self._name, "stop", "standstill", got, "press the emergency stop")

    def _stranger(self, port: P, proven: bool) -> str:
        """Return an empty text if the expected stage answers, otherwise the identity of the other device."""
        found = self._identity if proven else self._talk.identity(port, self._answer_s)
        return "" if found == self._identity else f"the device {found}"

    def close(self) -> None:
        """Release the line without stopping the stage. A repeated call has no effect."""
        self._release_port()
        self._line.close()

    def _opened(self) -> P:
        if self._port is None:
            try:
                channel = self._line.channel()
            except CHANNEL_ERRORS as error:
                raise cannot_open(self._name, "open port for the guardian", self._url, error) from error
            self._port = self._talk.open_port(self._name, channel, self._answer_s)
        return self._port

    def _release_port(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()


def guard_spec(talk: Callable[[StageSettings], StageTalk[P]]) -> GuardSpec:
    """Return the `GuardSpec` with which a guardian process guards the stages of a driver.

    ``talk(settings)`` returns the `StageTalk` for a stage with these settings.
    """
    return GuardSpec(
        line=lambda settings: shared_line(settings.port),
        open=lambda settings, context: StageGuard(settings, context, talk(settings)),
    )
