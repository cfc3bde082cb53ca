"""The contract tests of cameras with Aravis' fake camera, in a separate network (`test_gige_camera`)."""

import signal
import subprocess
from collections.abc import Iterator
from contextlib import closing

import pytest

from drivers.testing import CameraBench, CameraContract
from tests.real_cameras.gige.guest_aravis import CLOCK, EXPOSURE_US, RATE_HZ, opened, plugged


@pytest.fixture(scope="module")
def process() -> Iterator[subprocess.Popen[bytes]]:
    with plugged() as process:
        yield process


class TestGigeCamera(CameraContract):
    @pytest.fixture
    def bench(self, process: subprocess.Popen[bytes]) -> Iterator[CameraBench]:
        process.send_signal(signal.SIGCONT)  # whatever became of the test before
        with closing(opened()) as camera:
            yield CameraBench(
                camera,
                CLOCK,
                "camera",
                interval_s=1 / RATE_HZ,
                reopen=opened,
                exposure_us=EXPOSURE_US,
                gain=1.0,
                tolerance_s=1.0,
                stall=lambda: process.send_signal(signal.SIGSTOP),
                go_on=lambda: process.send_signal(signal.SIGCONT),
            )
