"""The two messages of a guardian to a Zaber stage: a stop, and a question for the serial number."""

from functools import partial

from drivers.lines.line_guard import LineTalk, guard_spec
from drivers.stages.zaber.port import BAUD, ZaberPort
from drivers.stages.zaber.protocol import Reply, reason
from drivers.stages.zaber.settings import ZaberSettings

ENDS = b"\n\r"


def stop_once(settings: ZaberSettings, port: ZaberPort, answer_s: float) -> str:
    """Send the stop command once. Return an empty text if the stage stands still, otherwise what happened.

    Raise `DeviceTimeout` if no complete answer came in time, and `LinkLost` if the connection to the device
    is lost.
    """
    reply = port.ask(settings.address, settings.axis, "stop", at_most_s=answer_s)
    if reply.address != settings.address:
        return foreign(reply)
    if not reply.accepted:
        return reason(reply)
    return "a stage in motion" if reply.busy else ""


def serial_number(settings: ZaberSettings, port: ZaberPort, answer_s: float) -> str:
    """Return the serial number of the device. Raise the same errors as `stop_once`."""
    return port.ask(settings.address, 0, "get system.serial", at_most_s=answer_s).data


def foreign(reply: Reply) -> str:
    """Return the reason why a stop is not confirmed: a text that names the other device that answered."""
    return f"an answer of device {reply.address}"


def _talk(settings: ZaberSettings) -> LineTalk[ZaberPort]:
    stop, identity = partial(stop_once, settings), partial(serial_number, settings)
    return LineTalk(settings.port, BAUD, ENDS, ZaberPort, stop, identity, settings.reply_timeout_s)


GUARD = guard_spec(_talk)
