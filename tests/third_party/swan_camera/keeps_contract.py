"""The test suite of the third party's package: its camera passes the contract tests."""

from collections.abc import Iterator
from contextlib import closing

import pytest
from swan_camera import SPEC, SwanCamera, SwanSettings

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.testing import CameraBench, CameraContract


class TestSwanCamera(CameraContract):
    @pytest.fixture
    def bench(self) -> Iterator[CameraBench]:
        context = OpenContext("cameras.left", VirtualClock())

        def opened() -> SwanCamera:
            return SPEC.open(SwanSettings(serial="S-0042"), context)

        with closing(opened()) as camera:
            yield CameraBench(
                camera,
                context.clock,
                context.name,
                interval_s=5e-3,
                reopen=opened,
                exposure_us=5000.0,
                gain=1.0,
            )
