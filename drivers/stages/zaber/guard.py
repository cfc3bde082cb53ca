"""Messages of a guardian to a Zaber stage: the stop, and the question for the serial number."""

from functools import partial

from drivers.stages.guard import StageTalk, guard_spec
from drivers.stages.settings import StageSettings
from drivers.stages.zaber.port import BAUD, ZaberPort
from drivers.stages.zaber.protocol import Reply, reason
from drivers.stages.zaber.settings import ZaberSettings

ENDS = b"\n\r"


def stop_once(settings: ZaberSettings, port: ZaberPort, answer_s: float) -> str:
    """Send the stop command once; return an empty text if the stage stands still, otherwise the reason.

    Raises
    ------
    DeviceTimeout
        If no complete answer came in time.
    LinkLost
        If the connection to the device is lost.
    """
    reply = port.ask(settings.address, settings.axis, "stop", at_most_s=answer_s)
    if reply.address != settings.address:
        return foreign(reply)
    if not reply.accepted:
        return reason(reply)
    return "a stage in motion" if reply.busy else ""


def serial_number(settings: ZaberSettings, port: ZaberPort, answer_s: float) -> str:
    """Return the serial number of the device; raise the same errors as `stop_once`."""
    return port.ask(settings.address, 0, "get system.serial", at_most_s=answer_s).data


def foreign(reply: Reply) -> str:
    """Return a text that says which other device has answered, as the reason why the stop is not
    confirmed."""
    return f"an answer of device {reply.address}"


def _talk(settings: StageSettings) -> StageTalk[ZaberPort]:
    assert isinstance(settings, ZaberSettings)
    return StageTalk(BAUD, ENDS, ZaberPort, partial(stop_once, settings), partial(serial_number, settings))


GUARD = guard_spec(_talk)
