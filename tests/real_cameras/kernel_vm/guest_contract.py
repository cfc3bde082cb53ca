"""The contract tests of cameras with the kernel's virtual camera, in the virtual machine."""

from collections.abc import Iterator
from contextlib import closing

import pytest

from drivers.testing import CameraBench, CameraContract
from tests.real_cameras.kernel_vm.guest import CLOCK, left_open, opened, turn

RATE_HZ = 60.0
GAIN = 42
DROPPED = "Percentage of Dropped Buffers"


class TestVivid(CameraContract):
    @pytest.fixture
    def bench(self) -> Iterator[CameraBench]:
        turn(DROPPED, 0)
        with closing(opened(rate_hz=RATE_HZ, gain=GAIN)) as camera:
            yield CameraBench(
                camera,
                CLOCK,
                "camera",
                interval_s=1 / RATE_HZ,
                reopen=lambda: opened(rate_hz=RATE_HZ, gain=GAIN),
                gain=GAIN,
                tolerance_s=0.5,
                stall=lambda: turn(DROPPED, 100, camera=camera),
                go_on=lambda: turn(DROPPED, 0, camera=camera),
                lose=lambda: turn(DROPPED, 50, camera=camera),
                held=lambda: len(left_open()),
            )
        assert left_open() == []
