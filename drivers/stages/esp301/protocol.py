"""Newport ESP301 messages: meaning of answers and errors; bytes and texts only, no port.

A command is an axis number, two letters and a value, ended by CR; ``?`` asks. There are no ids and no
checksums, and a command is not acknowledged: errors wait in a queue, ten deep, that ``TB?`` empties.
Source: Newport ESP301 User's Manual, command set, and appendix on error messages.
"""

import re
from dataclasses import dataclass

DEGREES = 7
QUEUE_DEPTH = 10
END = b"\r"
MODEL = re.compile(r"(?P<model>ESP30\w) +[Vv]ersion +(?P<firmware>\S+).*")
_ERROR = re.compile(r"(?P<code>\d+) *, *(?P<stamp>\d+) *, *(?P<text>.*)")

# A command arrived that the controller does not understand: noise on the line, not a fault of the stage.
MISUNDERSTOOD = frozenset({6, 7, 9, 37, 38})
NOT_OF_AN_AXIS = 100

# Axis errors (code minus 100 times the axis number) that only mean that a command was not accepted. After
# every other axis error the last motion has failed or cannot be trusted.
NOT_TAKEN = frozenset({1, 10, 11, 15, 16, 17, 24, 25, 26, 27, 28, 30, 31, 32})
# Errors that may mean a refused command: software limit, motor off. They can also occur in motion.
PERHAPS_NOT_TAKEN = frozenset({6, 7, 13})

# Bits of the software limits' configuration, ``ZS``: limits watched; motor switched off or stopped.
LIMITS_WATCHED = 1 << 0
LIMITS_ACTED_ON = 1 << 1 | 1 << 2


@dataclass(frozen=True)
class QueuedError:
    """An entry of the error queue; code 0 means that the queue is empty."""

    code: int
    text: str

    @property
    def axis(self) -> int:
        """The axis of the error; 0 for the controller."""
        return self.code // NOT_OF_AN_AXIS

    def __str__(self) -> str:
        return f"error {self.code} ({self.text.lower()})"

    def fails(self, axis: int) -> bool:
        """Whether the error means that the last motion of `axis` failed."""
        if self.axis == 0:
            return self.code not in (0, *MISUNDERSTOOD)
        return self.axis == axis and self.code % NOT_OF_AN_AXIS not in NOT_TAKEN

    def may_refuse(self, axis: int) -> bool:
        """Whether the error may only mean a refused command to `axis`; the earlier motion is intact."""
        return self.axis == axis and self.code % NOT_OF_AN_AXIS in PERHAPS_NOT_TAKEN


def read_error(line: str) -> QueuedError:
    """Read the answer to ``TB?``; `ValueError` if the line is not such an answer."""
    match = _ERROR.fullmatch(line)
    if match is None:
        raise ValueError(f"{line!r} instead of an error's code, time and text")
    return QueuedError(int(match["code"]), match["text"].strip())


def read_number(line: str) -> float:
    """Read a number; `ValueError` if the line is not a number."""
    if re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", line) is None:
        raise ValueError(f"{line!r} instead of a number")
    return float(line)


def read_bits(line: str) -> int:
    """Read a hexadecimal number such as ``5H``; `ValueError` for any other line."""
    match = re.fullmatch(r"([0-9A-F]+)H?", line)
    if match is None:
        raise ValueError(f"{line!r} instead of a hexadecimal number")
    return int(match[1], 16)


def read_name(line: str) -> str:
    """Read the identity of a stage; `ValueError` if the line is the version of the controller."""
    if MODEL.fullmatch(line):
        raise ValueError(f"{line!r} instead of a stage's name")
    return line


def read_switch(line: str) -> bool:
    """Read 0 or 1; `ValueError` for any other line."""
    if line not in ("0", "1"):
        raise ValueError(f"{line!r} instead of 0 or 1")
    return line == "1"
