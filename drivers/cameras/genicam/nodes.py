"""Interface of the features of an opened GenICam camera, whichever library reads them."""

import re
from typing import Protocol

AUTOMATICS = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto")
"""Automatic controls that change grey levels."""
VERSIONS = ("DeviceVersion", "DeviceFirmwareVersion")
TEXT_MAX = 200
TOLERANCE = 1e-3


class Nodes(Protocol):
    """The features (nodes) of a camera, by their names of the GenICam standard.

    All methods raise `DeviceFault` if the camera refuses, and `LinkLost` if it does not answer.
    """

    def has(self, feature: str) -> bool:
        """Return whether the camera has the feature now."""

    def text(self, feature: str) -> str:
        """Return the value of a feature as text."""

    def set_text(self, feature: str, wanted: str) -> None:
        """Set a string or an enumeration, read it back, and refuse a difference."""

    def set_switch(self, feature: str, on: bool) -> None:
        """Set a feature that is true or false."""

    def switch(self, feature: str) -> bool:
        """Return whether a feature is true."""

    def integer(self, feature: str) -> int:
        """Return the value of an integer."""

    def execute(self, feature: str) -> None:
        """Execute a command."""


def snake(feature: str) -> str:
    """Return the name of a GenICam feature in lower case, with underscores between its words."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|[^A-Za-z0-9]+", "_", feature).strip("_").lower()


def printable(text: str) -> str:
    """Return a text of a camera without control characters, and not longer than a setting may be."""
    return "".join(sign for sign in text if sign.isprintable())[:TEXT_MAX]


def agree(got: float, wanted: float) -> bool:
    """Return whether a number that was read back is the one that was written, but for rounding."""
    return abs(got - wanted) <= TOLERANCE * max(abs(wanted), TOLERANCE)
