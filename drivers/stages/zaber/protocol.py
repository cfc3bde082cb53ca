"""Zaber ASCII protocol, version 3: messages, checksums, flags and reject reasons; bytes only, no port.

Every request has an id and a checksum, so every answer must have the same id and its own checksum. Source:
Zaber ASCII Protocol Manual (https://www.zaber.com/protocol-manual), chapters Message Format, Warning Flags
and Rejection Reasons.
"""

import re
from dataclasses import dataclass

# A speed in a message is microsteps per second times this factor.
SPEED_UNIT = 1.6384
IDS = range(100)

_REPLY = re.compile(
    r"@(?P<address>\d\d) (?P<axis>\d+) (?P<id>\d\d) (?P<outcome>OK|RJ) (?P<status>BUSY|IDLE) "
    r"(?P<flag>--|[A-Z0-9]{2}) (?P<data>.*)"
)

# Flags of a position counter without a reference.
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
    """An answer of the stage.

    Attributes
    ----------
    address, axis, id : int
        The device and axis that answered, and the id of the request.
    accepted : bool
        OK or RJ.
    busy : bool
        True while the axis moves.
    flag : str
        The most severe warning flag, or ``--``.
    data : str
        The requested value, or the reason of a rejection.
    """

    address: int
    axis: int
    id: int
    accepted: bool
    busy: bool
    flag: str
    data: str


def is_fault(flag: str) -> bool:
    """Whether motion failed or is impossible: all fault flags of the manual, even those not listed here."""
    return flag.startswith("F") or flag == "WL"


def lrc(text: str) -> str:
    """Longitudinal redundancy check, two hexadecimal digits.

    Parameters
    ----------
    text : str
        The text between the message's first character and its colon.
    """
    return f"{-sum(text.encode('ascii')) & 0xFF:02X}"


def encode(address: int, axis: int, id: int, command: str) -> bytes:
    """Return the bytes of a request; an empty command asks for the status."""
    body = f"{address} {axis} {id:02d}"
    if command:
        body += f" {command}"
    return f"/{body}:{lrc(body)}\n".encode("ascii")


def decode(line: bytes) -> Reply | None:
    """Read one line from the stage, without its line end.

    Returns
    -------
    Reply or None
        None for alerts (``!``) and information (``#``), which answer nothing.

    Raises
    ------
    DamagedLineError
        If the line is not a reply, or its checksum is missing or wrong.
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
