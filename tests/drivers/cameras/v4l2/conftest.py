"""Fixtures with a simulated kernel's camera and the V4L2 driver. The driver must release everything at the
end."""

from collections.abc import Iterator

import pytest

from drivers.cameras.v4l2.camera import V4l2Camera
from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from tests.drivers.cameras.fake_kernel import FakeCamera
from tests.drivers.cameras.v4l2.opening import opened


@pytest.fixture
def clock() -> VirtualClock:
    clock = VirtualClock()
    clock.sleep(100.0)
    return clock


@pytest.fixture
def plugged(clock: VirtualClock) -> Iterator[FakeCamera]:
    camera = FakeCamera(clock)
    yield camera
    assert camera.open_nodes == 0
    assert camera.mapped == 0


@pytest.fixture
def camera(plugged: FakeCamera, context: OpenContext) -> Iterator[V4l2Camera]:
    camera = opened(plugged, context)
    yield camera
    camera.close()
    camera.close()
