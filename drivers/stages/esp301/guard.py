"""The two messages of a guardian to a stage on a Newport ESP301: a stop, and a question for the identity."""

from functools import partial

from drivers.lines.line_guard import LineTalk, guard_spec
from drivers.stages.esp301.port import EspPort
from drivers.stages.esp301.protocol import END, read_name, read_switch
from drivers.stages.esp301.settings import EspSettings


def stop_once(axis: int, port: EspPort, answer_s: float) -> str:
    """Command a stop once. Return an empty text if the stage stands still, otherwise what the stage does.

    Raise `DeviceTimeout` if no answer came in time, or the answer may belong to an earlier question, and
    `LinkLost` if the connection to the controller is lost.
    """
    port.send(f"{axis}ST")
    stands = port.ask_first(f"{axis}MD?", read_switch, answer_s)
    return "" if stands else "a stage in motion"


def identity(axis: int, port: EspPort, answer_s: float) -> str:
    """Return the name of the stage. Raise the same errors as `stop_once`."""
    return port.ask_first(f"{axis}ID?", read_name, answer_s)


def _talk(settings: EspSettings) -> LineTalk[EspPort]:
    stop, name = partial(stop_once, settings.axis), partial(identity, settings.axis)
    return LineTalk(settings.port, settings.baud, END, EspPort, stop, name, settings.reply_timeout_s)


GUARD = guard_spec(_talk)
