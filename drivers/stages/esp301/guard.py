"""The two messages of a guardian to a stage on a Newport ESP301: a stop, and a question for the identity."""

from functools import partial

from drivers.stages.esp301.port import EspPort
from drivers.stages.esp301.protocol import END, read_name, read_switch
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.guard import StageTalk, guard_spec
from drivers.stages.settings import StageSettings


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


def _talk(settings: StageSettings) -> StageTalk[EspPort]:
    assert isinstance(settings, EspSettings)
    axis = settings.axis
    return StageTalk(settings.baud, END, EspPort, partial(stop_once, axis), partial(identity, axis))


GUARD = guard_spec(_talk)
