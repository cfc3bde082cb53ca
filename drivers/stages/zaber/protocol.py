"""Messages, checksums, flags and rejection reasons of the Zaber ASCII protocol, version 3.

This module does not use the port. Every request has an id and a checksum. An answer must have the id of its
request and a checksum of its own. Source: Zaber ASCII Protocol Manual
(https://www.zaber.com/protocol-manual), chapters Message Format, Warning Flags and Rejection Reasons.
"""

import re
from dataclasses import dataclass

# The speed value in a message is the speed in microsteps per second times this factor.
SPEED_UNIT = 1.6384
# An acceleration in a message is microsteps per second squared times this factor.
ACCELERATION_UNIT = 1.6384e-4
IDS = range(100)

_REPLY = re.compile(
    r"@(?P<address>\d\d) (?P<axis>\d+) (?P<id>\d\d) (?P<outcome>OK|RJ) (?P<status>BUSY|IDLE) "
    r"(?P<flag>--|[A-Z0-9]{2}) (?P<data>.*)"
)

# Warning flags which mean that the stage has no reference position.
NOT_REFERENCED = frozenset({"WR", "WH"})

FLAGS = {
    "FA": "the encoder is out of step",
    "FB": "the bounds of a stream were passed",
    "FC": "a current inrush",
    "FD": "the motor driver switched itself off",
    "FE": "a limit error",
    "FF": "a system error",
    "FH": "the hardware emergency stop is pressed",
    "FI": "the index mark is not where it was",
    "FM": "the motor is too hot",
    "FN": "the stage is not supported by its controller",
    "FO": "the motor driver is switched off",
    "FP": "the stage left its path",
    "FQ": "an encoder error",
    "FR": "the motor was overdriven",
    "FS": "the stage stalled",
    "FT": "a twist beyond what is allowed",
    "FV": "the supply voltage is out of range, and the motor driver off",
    "FZ": "the stage is not active",
    "WL": "an unexpected limit switch",
}
UNKNOWN_COMMAND = "BADCOMMAND"

REJECTIONS = {
    "BADDATA": "the value is out of range or beyond the stage's own limits",
    "BADCOMMAND": "the stage does not know the command",
    "BADAXIS": "the stage has no such axis",
    "DRIVERDISABLED": "the motor driver is off",
    "PARKED": "the axis is parked",
    "STATUSBUSY": "the axis is busy",
    "AGAIN": "the stage cannot do it right now",
    "REMOTE": "the stage is under remote control",
}


class DamagedLineError(ValueError):
    """A line that is not a reply, or whose checksum is missing or wrong."""


@dataclass(frozen=True)
class Reply:
    """An answer of a Zaber device."""

    # address of the device, number of the axis, and id of the request
    address: int
    axis: int
    id: int
    # True if the device accepted the request (``OK``), False if the device rejected it (``RJ``)
    accepted: bool
    busy: bool  # True while the axis moves
    flag: str  # the most severe warning flag of the stage, or ``--`` without a warning
    data: str  # the requested value, or the reason of a rejection


def is_fault(flag: str) -> bool:
    """Return whether a flag means that a motion failed or is impossible: WL, or one that begins with F."""
    return flag.startswith("F") or flag == "WL"


def lrc(text: str) -> str:
    """Return the checksum of a message: the longitudinal redundancy check, as two hexadecimal digits.

    `text` is the text of the message between its first character and the colon.
    """
    return f"{-sum(text.encode('ascii')) & 0xFF:02X}"


def encode(address: int, axis: int, id: int, command: str) -> bytes:
    """Return the bytes of a request. An empty command asks for the status."""
    body = f"{address} {axis} {id:02d}"
    if command:
        body += f" {command}"
    return f"/{body}:{lrc(body)}\n".encode("ascii")


def decode(line: bytes) -> Reply | None:
    """Return the reply in one line from the stage. The line must not contain its line end.

    Return None for alerts (``!``) and information (``#``), which are not answers to a request. Raise
    `DamagedLineError` if the line is not a reply, or its checksum is missing or wrong.
    """
    text = line.decode("ascii", "backslashreplace")
    if re.match(r"[!#]\d\d ", text):
        return None
    body, colon, received = text.rpartition(":")
    match = _REPLY.fullmatch(body)
    if not colon or match is None or received != lrc(body[1:]):
        raise DamagedLineError(text)
    return Reply(
        address=int(match["address"]),
        axis=int(match["axis"]),
        id=int(match["id"]),
        accepted=match["outcome"] == "OK",
        busy=match["status"] == "BUSY",
        flag=match["flag"],
        data=match["data"],
    )


def reason(reply: Reply) -> str:
    """Return a text that explains why the device rejected a request."""
    return f"rejection {reply.data} ({REJECTIONS.get(reply.data, 'see the manual')})"
