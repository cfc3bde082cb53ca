"""Tests of the GigE Vision driver with Aravis' fake camera, in a separate network (`test_gige_camera`)."""

import statistics
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from drivers.cameras.aravis.camera import AravisCamera, open_camera
from drivers.cameras.aravis.find import vision_cameras
from drivers.cameras.aravis.settings import AravisSettings
from drivers.clock import SystemClock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.streams.losses import LossKind

CLOCK = SystemClock()
RATE_HZ = 25.0
EXPOSURE_US = 10_000.0
LONG_S = 1.0


@contextmanager
def plugged(*options: str) -> Iterator[subprocess.Popen[bytes]]:
    """Aravis' fake camera, running in a separate process."""
    command = ["arv-fake-gv-camera-0.8", "-i", "127.0.0.1", "-s", "GV77", *options]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def opened(**changes: Any) -> AravisCamera:
    """Open the fake camera as soon as it answers."""
    values = {
        "camera": "127.0.0.1",
        "width_px": 256,
        "height_px": 128,
        "rate_hz": RATE_HZ,
        "exposure_us": EXPOSURE_US,
        "gain": 1.0,
        "transfer_us": 0.0,
    }
    settings = AravisSettings.model_validate(values | changes)
    deadline_s = CLOCK.now_s() + 10
    while True:
        try:
            return open_camera(settings, OpenContext("camera", CLOCK))
        except LinkLost:
            if CLOCK.now_s() > deadline_s:
                raise


@pytest.fixture(autouse=True)
def nothing_is_left() -> Iterator[None]:
    threads = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) <= threads


@pytest.fixture
def camera() -> Iterator[AravisCamera]:
    with plugged():
        camera = opened()
        yield camera
        camera.close()
        camera.close()


def test_says_who_it_is_and_films_at_full_depth() -> None:
    with plugged():
        for code, bits, dtype in (("Mono8", 8, np.uint8), ("Mono16", 16, np.uint16)):
            camera = opened(format=code)
            frame = camera.grab(5.0)
            camera.close()
            assert (camera.info.vendor, camera.info.model, camera.info.serial) == ("Aravis", "Fake", "GV77")
            assert (camera.info.bits, frame.image.dtype, frame.image.shape) == (bits, dtype, (128, 256))
            assert frame.flags == 0
            assert (frame.exposure_us, frame.gain) == (EXPOSURE_US, 1.0)
            assert np.ptp(frame.image) > 50 << (bits - 8)


def test_is_found_on_its_network_and_opened_by_the_name_found() -> None:
    with plugged():
        opened().close()  # it answers by now
        (found,) = vision_cameras()
        assert found.what == "Aravis Fake GV77 (GigEVision at 127.0.0.1)"
        camera = opened(camera=found.place)
        assert camera.info.serial == "GV77"
        camera.close()


def test_a_frame_was_exposed_after_the_call_whatever_the_pause(camera: AravisCamera) -> None:
    waits_s, begins_s, last = [], [], None
    for pause_s in (0.0, 0.01, 0.1, LONG_S) * 4:
        CLOCK.sleep(pause_s)
        asked_s = CLOCK.now_s()
        frame = camera.grab(5.0)
        waits_s.append(CLOCK.now_s() - asked_s)
        begins_s.append(frame.exposed_s - asked_s)
        assert frame.exposed_s >= asked_s
        # one that had waited would carry the number after the last, however slow the camera is
        if last is not None:
            assert frame.sequence - last.sequence > (1 if pause_s == LONG_S else 0)
        last = frame
    median_s = statistics.median(waits_s)
    print(f"fresh frame at 25 Hz: median {median_s * 1e3:.0f} ms, longest {max(waits_s) * 1e3:.0f} ms")
    assert statistics.median(begins_s) <= 1.5 / RATE_HZ


def test_what_the_camera_does_not_take_is_refused() -> None:
    with plugged():
        opened().close()
        for changes, message in [
            ({"format": "Mono14"}, "set format: expected acceptance, got .*'Mono14'"),
            ({"features": {"GainAuto": "Sometimes"}}, "set GainAuto: expected acceptance"),
            ({"features": {"Sharpness": "Off"}}, "set Sharpness: .*correct `features`"),
        ]:
            with pytest.raises(DeviceFault, match=message):
                opened(**changes).close()
        opened().close()


def test_no_loss_stays_unnoticed() -> None:
    with plugged("-r", "5"):
        camera = opened(rate_hz=50.0)
        with camera.stream(capacity=1000) as stream:
            frames = [stream.next(5.0) for _ in range(250)]
        camera.close()
    report = stream.report()
    sequences = [frame.sequence for frame in frames]
    missing = set(range(sequences[0], sequences[-1])) - set(sequences)
    reported = {
        loss.first + i
        for loss in report.losses
        if loss.kind in (LossKind.GAP, LossKind.DAMAGED)
        for i in range(loss.count)
    }
    print(f"{len(frames)} frames, {len(missing)} lost or damaged, all reported")
    # what came before the first whole frame or after the last one that was taken is told as well
    assert {number for number in reported if sequences[0] < number < sequences[-1]} == missing
    assert sequences == sorted(set(sequences))


def test_a_camera_that_dies_is_given_up_in_time_and_taken_again() -> None:
    with plugged():
        camera = opened()
        camera.grab(5.0)
    asked_s = CLOCK.now_s()
    with pytest.raises(DeviceTimeout, match=r"grab: .* within 0\.5 s, got none; check cable"):
        camera.grab(0.5)
    with pytest.raises(DeviceTimeout, match="still being given up or made"):
        camera.grab(0.5)
    noticed_s = CLOCK.now_s() - asked_s
    print(f"dead camera: two calls with a deadline of 0.5 s each took {noticed_s:.2f} s together")
    # each of the two would take Aravis 2.5 s at the least if it did not happen aside
    assert noticed_s < 2.5
    with pytest.raises(LinkLost, match=r"expected the camera with serial number GV77, got .*127\.0\.0\.1"):
        camera.grab(60.0)
    with pytest.raises(DeviceTimeout, match="being given up or made"):
        camera.grab(0.5)
    with plugged():
        deadline_s = CLOCK.now_s() + 10
        while CLOCK.now_s() < deadline_s:
            try:
                assert camera.grab(1.0).flags == 0
                break
            except DeviceError:
                continue
        else:
            raise AssertionError("never taken again")
        camera.close()


def test_a_second_program_is_refused_the_control(camera: AravisCamera) -> None:
    with pytest.raises(DeviceError) as refused:
        open_camera(camera._settings, OpenContext("second", CLOCK))
    assert str(refused.value) == (
        "second (127.0.0.1): open camera: expected a free camera, got one that another program controls; "
        "check cable, power and address, and that no other program controls the camera"
    )
    assert camera.grab(5.0).flags == 0


def test_a_triggered_camera_waits_for_its_triggers_and_is_not_given_up() -> None:
    with plugged():
        camera = opened(trigger="Software")
        found = camera.read_settings()
        assert (found["trigger_mode"], found["trigger_source"]) == ("On", "Software")
        first = camera._session
        for _ in range(2):
            with pytest.raises(DeviceTimeout, match="got none; check trigger line and cable"):
                camera.grab(0.5)
        assert camera._session is first
        session = camera._session
        assert session is not None
        waits_s = []
        with camera.stream() as stream:
            for _ in range(6):
                with pytest.raises(DeviceTimeout):
                    stream.next(0.2)
                asked_s = CLOCK.now_s()
                session._features.execute("TriggerSoftware")
                frame = stream.next(2.0)
                waits_s.append(CLOCK.now_s() - asked_s)
                assert frame.flags == 0
        print(f"frame after a software trigger: median {statistics.median(waits_s) * 1e3:.0f} ms")
        camera.close()


def test_lines_and_a_clock_that_the_camera_does_not_have_are_refused() -> None:
    with plugged():
        opened().close()
        for changes, message in [
            ({"output": "Line1"}, "expected a camera with LineSelector, got none"),
            ({"trigger": "Line7"}, "set TriggerSource: expected acceptance"),
            ({"stamp": "start"}, "expected TimestampLatch or GevTimestampControlLatch, got a camera"),
        ]:
            with pytest.raises(DeviceFault, match=message):
                opened(**changes).close()
        opened().close()


def test_a_stream_has_the_camera_to_itself(camera: AravisCamera) -> None:
    with camera.stream() as stream:
        assert stream.next(5.0).flags == 0
        with pytest.raises(DeviceFault, match="expected no open stream, got a stream that takes every frame"):
            camera.grab(1.0)
    assert camera.grab(5.0).flags == 0
