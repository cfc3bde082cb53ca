"""Meaning of the answers and errors of a Newport ESP301. This module does not use the port.

A command is an axis number, two letters and a value, and ends with CR (carriage return). A question ends with
``?``. Messages have no ids and no checksums, and the controller sends no answer to a command. Errors wait in
a queue of ten entries. The question ``TB?`` returns and removes the oldest error. Source: Newport ESP301
User's Manual, command set, and appendix on error messages.
"""

import re
from dataclasses import dataclass

DEGREES = 7
QUEUE_DEPTH = 10
END = b"\r"
MODEL = re.compile(r"(?P<model>ESP30\w) +[Vv]ersion +(?P<firmware>\S+).*")
_ERROR = re.compile(r"(?P<code>\d+) *, *(?P<stamp>\d+) *, *(?P<text>.*)")

# Errors for a command that the controller does not understand. Their cause is noise on the line.
MISUNDERSTOOD = frozenset({6, 7, 9, 37, 38})
NOT_OF_AN_AXIS = 100

# Axis errors (code minus 100 times the axis number) which only mean that a command was not accepted. Every
# other axis error means that the last motion has failed or may not have reached its target.
NOT_TAKEN = frozenset({1, 10, 11, 15, 16, 17, 24, 25, 26, 27, 28, 30, 31, 32})
# Errors that may mean a refused command (software limit, motor off). These errors can also occur in motion.
PERHAPS_NOT_TAKEN = frozenset({6, 7, 13})

# Bits of ``ZS``, the configuration of the software limits. Bit 0 makes the controller watch the limits. Bit 1
# or bit 2 makes it stop the motor at a limit.
LIMITS_WATCHED = 1 << 0
LIMITS_ACTED_ON = 1 << 1 | 1 << 2


@dataclass(frozen=True)
class QueuedError:
    """An entry of the error queue. Code 0 means that the queue is empty."""

    code: int
    text: str

    @property
    def axis(self) -> int:
        """Number of the axis that has the error, or 0 for the controller itself."""
        return self.code // NOT_OF_AN_AXIS

    def __str__(self) -> str:
        return f"error {self.code} ({self.text.lower()})"

    def fails(self, axis: int) -> bool:
        """Return whether the error means that the last motion of `axis` failed."""
        if self.axis == 0:
            return self.code not in (0, *MISUNDERSTOOD)
        return self.axis == axis and self.code % NOT_OF_AN_AXIS not in NOT_TAKEN

    def may_refuse(self, axis: int) -> bool:
        """Return whether the error may only mean that `axis` refused a command."""
        return self.axis == axis and self.code % NOT_OF_AN_AXIS in PERHAPS_NOT_TAKEN


def read_error(line: str) -> QueuedError:
    """Return the error in the answer to ``TB?``. Raise `ValueError` for any other line."""
    match = _ERROR.fullmatch(line)
    if match is None:
        raise ValueError(f"{line!r} instead of an error's code, time and text")
    return QueuedError(int(match["code"]), match["text"].strip())


def read_number(line: str) -> float:
    """Return the number in a line. Raise `ValueError` if the line is not a number."""
    if re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", line) is None:
        raise ValueError(f"{line!r} instead of a number")
    return float(line)


def read_bits(line: str) -> int:
    """Return the value of a hexadecimal number such as ``5H``. Raise `ValueError` for any other line."""
    match = re.fullmatch(r"([0-9A-F]+)H?", line)
    if match is None:
        raise ValueError(f"{line!r} instead of a hexadecimal number")
    return int(match[1], 16)


def read_name(line: str) -> str:
    """Return the identity of a stage. Raise `ValueError` if the line is the version of the controller."""
    if MODEL.fullmatch(line):
        raise ValueError(f"{line!r} instead of a stage's name")
    return line


def read_switch(line: str) -> bool:
    """Return False for the line ``0`` and True for ``1``. Raise `ValueError` for any other line."""
    if line not in ("0", "1"):
        raise ValueError(f"{line!r} instead of 0 or 1")
    return line == "1"
