"""Stage drivers with their simulated lines, so that the same test can be used for every driver."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext, RotationStage
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from simulators.stage.device import StageDevice

Answer = Callable[[], bytes]
Tamper = Callable[[str, Answer], bytes]
"""Type of a function that gets a command and a function `Answer`, and returns the bytes to send.

The function `Answer` executes the command and returns the regular answer.
"""


@dataclass(frozen=True)
class StageKit:
    """Functions that open a driver, and that start its simulator on a pseudo-terminal and on TCP.

    `settings` takes the port and changed settings. The object that `line` returns has the received commands
    in `received`, the motion commands in `motions()`, and a replaceable function `tamper`.
    """

    open_stage: Callable[[Any, OpenContext, StopTimes], RotationStage]
    settings: Callable[..., Any]
    line: Callable[[StageDevice, VirtualClock], Any]
    tcp_server: Callable[[StageDevice, VirtualClock], Any]

    def open(
        self, context: OpenContext, port: str, stop_times: StopTimes = STOP_TIMES, **changes: object
    ) -> RotationStage:
        return self.open_stage(self.settings(port, **changes), context, stop_times)


stops_end_soon = pytest.mark.parametrize("stop_times", [StopTimes(deadline_s=0.3)], ids=["soon"])
"""In tests with this mark, the deadline of an unconfirmed stop is 0.3 s."""


def untampered(command: str, answer: Answer) -> bytes:
    return answer()


def arrive(stage: RotationStage, clock: VirtualClock) -> float:
    """Wait in simulated time until the stage stands still, and return its angle."""
    for _ in range(10_000):
        state = stage.read()
        if not state.moving:
            return state.angle_deg
        clock.sleep(0.05)
    raise AssertionError("the stage never arrived")
