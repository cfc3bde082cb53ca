"""Tests of the OpenCV camera driver, with a simulated `VideoCapture` and with OpenCV itself."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from drivers.cameras.opencv.camera import UNPROVEN, OpencvCamera, open_camera
from drivers.cameras.opencv.settings import OpencvCameraSettings
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from tests.drivers.cameras.fake_opencv import INTERVAL_S, FakeCapture


def settings(**changes: object) -> OpencvCameraSettings:
    values = {"source": 0, "width_px": 32, "height_px": 20, "rate_hz": 25.0, "channel": "green"}
    return OpencvCameraSettings.model_validate(values | changes)


@pytest.fixture
def capture(clock: VirtualClock) -> FakeCapture:
    clock.sleep(10.0)
    return FakeCapture(clock)


@pytest.fixture
def camera(capture: FakeCapture, context: OpenContext) -> Iterator[OpencvCamera]:
    camera = OpencvCamera(settings(), context, capture)
    yield camera
    camera.close()
    camera.close()
    assert capture.released


@pytest.mark.parametrize("pause_s", [0.0, 0.03, 2.0, 100.0])
def test_waiting_frames_are_thrown_away_whatever_the_pause(pause_s, camera, capture, clock):
    camera.grab(1.0)
    clock.sleep(pause_s)
    asked_s = clock.now_s()
    frame = camera.grab(1.0)
    assert frame.exposed_s >= asked_s
    # the picture's number is its level: its exposure began at that many intervals
    assert capture.shown * INTERVAL_S >= asked_s
    assert (frame.image == capture.shown % 256).all()


def test_says_in_every_run_file_that_loss_is_unproven(camera):
    assert UNPROVEN in camera.info.model
    assert (camera.info.bits, camera.info.width_px) == (8, 32)
    assert find_driver("opencv-camera").kind == "camera"


def test_grey_levels_come_of_all_colours_of_green_or_as_they_are(capture, context, clock):
    frame = OpencvCamera(settings(channel="grey"), context, capture).grab(1.0)
    green = capture.shown % 256
    # by the weights of ITU-R BT.601 that OpenCV documents for its grey
    expected = 0.114 * (green // 2) + 0.587 * green + 0.299 * (green // 4)
    assert frame.image.mean() == pytest.approx(expected, abs=1)
    grey = FakeCapture(clock, coloured=False)
    assert (OpencvCamera(settings(), context, grey).grab(1.0).image == grey.shown % 256).all()


def test_what_is_not_taken_is_refused(capture, context):
    capture.clamped[cv2.CAP_PROP_EXPOSURE] = -6.0
    with pytest.raises(DeviceFault, match="set EXPOSURE: expected -5, got -6 on reading back"):
        OpencvCamera(settings(exposure=-5.0), context, capture)
    with pytest.raises(DeviceFault, match=r"set SHARPNES: expected a property of OpenCV"):
        OpencvCamera(settings(properties={"SHARPNES": 1.0}), context, capture)
    camera = OpencvCamera(settings(width_px=64), context, capture)
    with pytest.raises(DeviceFault, match="grab: expected 64 x 20 px as uint8, got shape"):
        camera.grab(1.0)


def test_a_slow_or_lost_camera_ends_in_its_error(camera, capture):
    with pytest.raises(DeviceTimeout, match=r"grab: expected a frame .* within 0.05 s, got none"):
        camera.grab(0.05)
    capture.unplugged = True
    with pytest.raises(LinkLost, match="got nothing from OpenCV, which does not say why"):
        camera.grab(1.0)
    capture.unplugged = False
    assert camera.grab(1.0).flags == 0
    camera.close()
    with pytest.raises(DeviceFault, match="expected an open camera, got a closed one"):
        camera.grab(1.0)


def test_a_call_does_not_wait_for_another_beyond_its_deadline(camera, capture):
    asked, going, read = threading.Event(), threading.Event(), capture.read

    def slowly() -> tuple[bool, np.ndarray | None]:
        asked.set()
        going.wait(60.0)
        return read()

    capture.read = slowly
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(camera.grab, 1.0)
        asked.wait(60.0)
        with pytest.raises(DeviceTimeout, match="a camera that no other call uses, got one in use"):
            camera.grab(0.01)
        going.set()
        assert other.result().flags == 0


def test_opencv_itself_reads_a_film(tmp_path: Path):
    """OpenCV reads a film file in place of a camera. The frames come in order, and no frame is buffered."""
    film = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for level in range(0, 200, 10):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    own = settings(source=str(film), width_px=64, height_px=48, buffered_frames=2, channel="grey")
    context = OpenContext("camera", SystemClock())
    camera = open_camera(own, context)
    levels = [camera.grab(5.0).image.mean() for _ in range(2)]
    camera.close()
    assert levels == pytest.approx([30, 70], abs=4)
    with pytest.raises(LinkLost, match="got none that OpenCV can open"):
        open_camera(settings(source=str(tmp_path / "nothing.avi")), context)


def test_simulated_time_is_refused(context):
    with pytest.raises(DeviceFault, match="use driver 'simulated-camera' in a simulated rig"):
        open_camera(settings(), context)


@pytest.mark.parametrize(
    "changes",
    [{"source": -1}, {"source": 2**40}, {"source": ""}, {"properties": {"FPS": 10.0}}, {"source": 1.5}],
)
def test_a_rig_file_cannot_say_nothing_or_something_twice(changes):
    with pytest.raises(ValidationError):
        settings(**changes)


def test_a_camera_that_is_refused_is_let_go(capture, monkeypatch):
    capture.isOpened = lambda: True
    monkeypatch.setattr(cv2, "VideoCapture", lambda source: capture)
    with pytest.raises(DeviceFault, match="set SHARPNES"):
        open_camera(settings(properties={"SHARPNES": 1.0}), OpenContext("camera", SystemClock()))
    assert capture.released
