"""Serial port to which a Newport ESP301 is connected.

The controller's answers have no number, but come in the order of the questions. After a missing or unexpected
answer, the port therefore asks for the controller's version and discards all answers that come before it.
"""

from drivers.lines.channel import Channel
from drivers.lines.line_port import LinePort, LineSyntax, Proof
from drivers.stages.esp301.protocol import END, MODEL
from drivers.stages.port import StagePort

_SYNTAX = LineSyntax(END, Proof("VE?", lambda line: MODEL.fullmatch(line) is not None))


class EspPort(LinePort, StagePort):
    """An exclusive port to an ESP301. No other program can use it, and any thread may call its methods."""

    def __init__(self, name: str, channel: Channel, reply_timeout_s: float) -> None:
        super().__init__(name, channel, reply_timeout_s, _SYNTAX)

    @property
    def version(self) -> str:
        """The version that the controller reports, or an empty text before the first answer."""
        return self.proven
