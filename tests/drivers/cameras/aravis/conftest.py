"""Fixtures with a simulated Aravis library, whose camera films on the virtual clock."""

import pytest

from drivers.clock import VirtualClock
from tests.drivers.cameras.fake_aravis import FakeLibrary


@pytest.fixture
def library(clock: VirtualClock) -> FakeLibrary:
    clock.sleep(100.0)
    return FakeLibrary(clock)
