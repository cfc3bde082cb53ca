"""The result of a check of a rig, to which the checks of all devices add."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RigCheck:
    """The result of a rig check: lines to print, a table of the devices for JSON, and the problems.

    `failed` gives the reason for each device that could not be checked.
    """

    lines: list[str]
    devices: dict[str, Any]
    problems: list[str]
    failed: dict[str, str]
