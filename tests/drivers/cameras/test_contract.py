"""Every camera driver of this project passes the contract tests. `guest_contract.py` tests other authors'
cameras."""

import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceTimeout
from drivers.interfaces import Camera, CameraInfo, Frame, OpenContext
from drivers.testing import CameraBench, CameraContract
from simulators.rig.camera import FreeRunningCamera, SimulatedCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.scene_client import CAMERA as REMOTE
from simulators.rig.scene_wire import SceneServer
from simulators.rig.surroundings import Surroundings
from simulators.scene.scene import Misalignment, Scene
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.wire.faults import CAMERA, FaultPanel
from tests.drivers.cameras import fake_aravis, fake_gentl, fake_opencv
from tests.fault_matrix.camera_benches import AravisBench, GentlBench, NumberedBench, OpencvBench, V4l2Bench
from tests.third_party.swan_camera.swan_camera import SwanCamera, SwanSettings

NAME = "cameras.left"
SMALL = CameraSettings(width_px=48, height_px=32, bits=12, exposure_us=8000.0, gain=1.5)


def bench_of(
    open_camera: Callable[[], Camera], clock: VirtualClock, faults: FaultPanel, **rest: Any
) -> CameraBench:
    return CameraBench(
        open_camera(),
        clock,
        NAME,
        reopen=open_camera,
        stall=lambda: faults.switch_on("stall"),
        go_on=faults.clear,
        lose=lambda: faults.switch_on("drop:1"),
        **rest,
    )


def simulated(end: ExitStack, name: str = NAME, settings: CameraSettings = SMALL) -> CameraBench:
    clock, faults = VirtualClock(), FaultPanel(CAMERA)
    specimen = SimulatedSpecimen(SpecimenSettings())
    scene = Scene(
        seed=1,
        misalignment=Misalignment(),
        specimen=specimen,
        angle_deg=lambda: 0.0,
        load_n=lambda: specimen.stretch_to(0.0),
    )
    clock.sleep(100.0)
    return bench_of(
        lambda: (FreeRunningCamera if settings.fps else SimulatedCamera)(
            name, settings, scene, clock, Surroundings.of(clock, faults)
        ),
        clock,
        faults,
        interval_s=1 / settings.fps if settings.fps else (settings.exposure_us + settings.readout_us) * 1e-6,
        exposure_us=settings.exposure_us,
        gain=settings.gain,
    )


def free_running(end: ExitStack) -> CameraBench:
    return simulated(end, settings=SMALL.model_copy(update={"fps": 50.0}))


def remote(end: ExitStack) -> CameraBench:
    there = simulated(end, "cameras.other")
    server = SceneServer({"other": there.camera}, None, lambda *_: None)
    end.callback(server.close)
    settings = REMOTE.settings(address=server.address, camera="other")

    def opened() -> Camera:
        return REMOTE.open(settings, OpenContext(NAME, there.clock))

    return replace(there, camera=opened(), reopen=opened)


def behind_a_seam(bench: NumberedBench, interval_s: float, **told: float) -> CameraBench:
    def shows(frame: Frame) -> float:
        assert frame.image.min() == frame.image.max()
        return bench.begun_s(int(frame.image[0, 0]))

    return bench_of(
        lambda: bench.opened(OpenContext(NAME, bench.clock)),
        bench.clock,
        bench.faults,
        interval_s=interval_s,
        shows=shows,
        held=lambda: sum(bench.left_behind().values()),
        **told,
    )


def v4l2(end: ExitStack) -> CameraBench:
    bench = V4l2Bench()
    return behind_a_seam(bench, bench.camera.interval_s, exposure_us=10_000.0, gain=20.0)


def aravis(end: ExitStack) -> CameraBench:
    return behind_a_seam(AravisBench(), fake_aravis.INTERVAL_S, exposure_us=5000.0, gain=3.0)


def gentl(end: ExitStack) -> CameraBench:
    exposure_us = fake_gentl.EXPOSURE_S * 1e6
    return behind_a_seam(GentlBench(), fake_gentl.INTERVAL_S, exposure_us=exposure_us, gain=2.0)


def opencv(end: ExitStack) -> CameraBench:
    bench = behind_a_seam(OpencvBench(), fake_opencv.INTERVAL_S, tolerance_s=2 * fake_opencv.INTERVAL_S)
    # OpenCV itself waits ten seconds for a camera that gives nothing, and then calls it lost
    return replace(bench, stall=None, go_on=None)


DRIVERS = {
    "simulated-camera": simulated,
    "simulated-camera, free-running": free_running,
    "remote-camera": remote,
    "v4l2": v4l2,
    "aravis": aravis,
    "gentl": gentl,
    "opencv-camera": opencv,
}


@pytest.mark.parametrize("driver", DRIVERS)
class TestCameras(CameraContract):
    @pytest.fixture
    def bench(self, driver: str) -> Iterator[CameraBench]:
        with ExitStack() as end:
            bench = DRIVERS[driver](end)
            with closing(bench.camera):
                yield bench


def test_calls_that_mix_are_found_and_no_debugger_is_pushed_aside(monkeypatch):
    context = OpenContext(NAME, VirtualClock())
    camera = SwanCamera(SwanSettings(serial="S-0042"), context)
    # as if its driver let two calls in at a time
    camera._lock = nullcontext()
    bench = CameraBench(camera, context.clock, NAME, interval_s=5e-3, reopen=lambda: camera)
    for module in (sys, threading):
        monkeypatch.setattr(module, "settrace", lambda function: pytest.fail("a debugger needs it"))
    with pytest.raises(AssertionError):
        CameraContract().test_calls_from_two_threads_do_not_mix(bench)


class PromptCamera:
    """A camera with a frame every 0.1 s, whose exposure and delivery take no time.

    The computer pauses after each of the first four frames, until the next frame is due in 10 ms.
    """

    def __init__(self, clock: VirtualClock, slowest_s: float) -> None:
        self.info = CameraInfo("made up", "prompt", "1", 4, 4, 8)
        self._clock, self._slowest_s, self._frames = clock, slowest_s, 0

    def grab(self, timeout_s: float) -> Frame:
        # whole milliseconds, because a rounding error must not lead to the frame before
        wait_s = (100 - round(self._clock.now_s() * 1000) % 100) / 1000
        allowed_s = max(timeout_s if timeout_s > 0 else 0.0, self._slowest_s)
        self._clock.sleep(min(wait_s, allowed_s))
        if wait_s > allowed_s:
            raise DeviceTimeout(NAME, "grab", "a frame", "none", "allow more time")
        self._frames += 1
        now_s, utc = self._clock.now_s(), self._clock.utc()
        if self._frames <= 4:
            self._clock.sleep(0.09)
        return Frame(np.zeros((4, 4), np.uint8), now_s, now_s, utc, self._frames, 0, math.nan, math.nan)

    def close(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize(("slowest_s", "kept"), [(0.0, True), (0.2, False)])
def test_a_pause_of_the_computer_breaks_no_deadline_but_a_driver_that_ignores_it_does(slowest_s, kept):
    clock = VirtualClock()
    camera = PromptCamera(clock, slowest_s)
    bench = CameraBench(camera, clock, NAME, interval_s=0.1, reopen=lambda: camera)
    with nullcontext() if kept else pytest.raises(AssertionError):
        CameraContract().test_a_deadline_that_cannot_be_kept_is_told_in_time(bench)
