"""Fixtures with the simulated camera of a GenTL producer, which films on the virtual clock."""

import pytest

from drivers.clock import VirtualClock
from tests.drivers.cameras.fake_gentl import FakeDevice


@pytest.fixture
def plugged(clock: VirtualClock) -> FakeDevice:
    clock.sleep(100.0)
    return FakeDevice(clock)
