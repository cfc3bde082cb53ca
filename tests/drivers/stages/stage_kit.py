"""A stage driver with its simulated line, so that one test can be used for every driver."""

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
"""Given a command, and what carries it out and returns the answer, return what is sent instead."""


@dataclass(frozen=True)
class StageKit:
    """How a driver is opened, and its simulator on a pty and on TCP.

    `settings` takes the port and what shall differ from the usual; `line` has `received`, `motions()` and a
    `tamper` to be set.
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
"""In this test a stop that is not confirmed has failed after 0.3 s."""


def untampered(command: str, answer: Answer) -> bytes:
    return answer()


def arrive(stage: RotationStage, clock: VirtualClock) -> float:
    """Wait in simulated time and return the angle."""
    for _ in range(10_000):
        state = stage.read()
        if not state.moving:
            return state.angle_deg
        clock.sleep(0.05)
    raise AssertionError("the stage never arrived")
