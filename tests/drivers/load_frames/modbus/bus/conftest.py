"""Fixtures for tests of Modbus RTU."""

from collections.abc import Iterator

import pytest

from drivers.load_frames.modbus.bus.link import ModbusLink
from tests.drivers.load_frames.modbus.bus.slaves import SHORT_S, Slave, linked


@pytest.fixture
def slave() -> Iterator[Slave]:
    made = Slave(lambda request: b"")
    yield made
    made.close()


@pytest.fixture
def hasty(slave: Slave) -> Iterator[ModbusLink]:
    yield from linked(slave, SHORT_S)
