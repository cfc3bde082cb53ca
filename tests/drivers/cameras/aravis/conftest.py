"""A library of the tests' own in place of libaravis, with a camera that films on the virtual clock."""

import pytest

from drivers.clock import VirtualClock
from tests.drivers.cameras.fake_aravis import FakeLibrary


@pytest.fixture
def library(clock: VirtualClock) -> FakeLibrary:
    clock.sleep(100.0)
    return FakeLibrary(clock)
