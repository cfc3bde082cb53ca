"""Fixtures with a simulated stage and its opened driver, for every driver unless a folder chooses one."""

from collections.abc import Iterator
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext, RotationStage
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from simulators.stage.device import StageDevice
from tests.drivers.stages.esp301.esp301_line import ESP301
from tests.drivers.stages.stage_kit import StageKit, arrive
from tests.drivers.stages.zaber.zaber_line import ZABER


@pytest.fixture(params=[ZABER, ESP301], ids=["zaber", "esp301"])
def kit(request: pytest.FixtureRequest) -> StageKit:
    return request.param


@pytest.fixture
def device(clock: VirtualClock) -> StageDevice:
    return StageDevice(clock, power_up_angle_deg=12.0)


@pytest.fixture
def line(kit: StageKit, device: StageDevice, clock: VirtualClock) -> Iterator[Any]:
    server = kit.line(device, clock)
    yield server
    server.close()


@pytest.fixture
def stop_times() -> StopTimes:
    return STOP_TIMES


@pytest.fixture
def stage(kit: StageKit, line: Any, context: OpenContext, stop_times: StopTimes) -> Iterator[RotationStage]:
    # longer than a busy computer keeps an answer back; tests of lost answers wait that long
    opened = kit.open(context, line.address, stop_times, reply_timeout_s=2.0)
    yield opened
    opened.close()


@pytest.fixture
def homed(stage: RotationStage, line: Any, clock: VirtualClock) -> RotationStage:
    stage.home()
    arrive(stage, clock)
    line.received.clear()
    return stage
