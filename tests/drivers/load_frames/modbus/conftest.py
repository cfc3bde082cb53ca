"""Fixtures with a simulated load frame, the port at which it answers, and the opened driver."""

from collections.abc import Iterator

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.load_frames.modbus.load_frame import ModbusLoadFrame, open_frame
from simulators.load_frame.device import LoadFrameDevice
from tests.drivers.load_frames.modbus.watched_port import Port, settings
from tests.spring import Spring


@pytest.fixture
def spring() -> Spring:
    return Spring()


@pytest.fixture
def device(clock: VirtualClock, spring: Spring) -> LoadFrameDevice:
    return LoadFrameDevice(clock, spring)


@pytest.fixture
def port(device: LoadFrameDevice) -> Iterator[Port]:
    server = Port(device)
    yield server
    server.close()
    server.close()


@pytest.fixture
def hold_times() -> StopTimes:
    return STOP_TIMES


@pytest.fixture
def frame(port: Port, context: OpenContext, hold_times: StopTimes) -> Iterator[ModbusLoadFrame]:
    opened = open_frame(settings(port.address), context, hold_times)
    yield opened
    opened.close()
    opened.close()
