"""The start of exposure that the V4L2 driver reports is never too late, and never before the call."""

import numpy as np
import pytest

from drivers.cameras.v4l2.abi import BufferFlag
from drivers.errors import DeviceFault, DeviceTimeout
from tests.drivers.cameras.v4l2.opening import EXPOSURE_US, opened


@pytest.mark.parametrize("pause_s", [0.0, 0.01, 0.5, 3600.0])
def test_a_frame_was_exposed_after_the_call_whatever_the_pause(pause_s, camera, clock):
    camera.grab(1.0)
    for phase in range(8):
        clock.sleep(pause_s + phase / 256)
        asked_s = clock.now_s()
        frame = camera.grab(1.0)
        assert frame.exposed_s >= asked_s
        assert frame.received_s - asked_s <= 1.5 / 32 + EXPOSURE_US * 1e-6 + 1 / 256 + 0.5 / 32


def test_the_stamp_of_a_usb_camera_is_the_first_packets_not_the_exposures(plugged, context):
    exposure_s = EXPOSURE_US * 1e-6
    for driver, transfer_us, early_s in [
        (b"uvcvideo", 0.0, exposure_s),
        (b"uvcvideo", 7000.0, exposure_s + 0.007),
        (b"uvcvideo", None, exposure_s + 1 / 32),
        (b"imx", None, 0.0),
    ]:
        plugged.driver = driver
        camera = opened(plugged, context, transfer_us=transfer_us)
        try:
            frame = camera.grab(1.0)
        finally:
            camera.close()
        stamp_s = plugged.begun_s + frame.sequence / 32
        assert frame.exposed_s == pytest.approx(stamp_s - early_s, abs=2e-6)


def test_a_stamp_at_the_end_counts_exposure_and_readout_back(plugged, context):
    plugged.stamp = BufferFlag.MONOTONIC
    plugged.stamp_offset_s = 1 / 32
    for transfer_us, back_s in ((None, 1 / 32), (5000.0, 0.005)):
        camera = opened(plugged, context, transfer_us=transfer_us)
        try:
            frame = camera.grab(1.0)
        finally:
            camera.close()
        stamp_s = plugged.begun_s + (frame.sequence + 1) / 32
        assert frame.exposed_s == pytest.approx(stamp_s - EXPOSURE_US * 1e-6 - back_s, abs=2e-6)


def test_the_middle_is_reckoned_from_what_the_stamp_marks(plugged, context):
    exposure_s = EXPOSURE_US * 1e-6
    jitter_s = 5e-4
    arrival = {"back_s": exposure_s / 2 + 0.005, "std_s": np.hypot(0.01 / np.sqrt(12), jitter_s)}
    start = {"back_s": -exposure_s / 2, "std_s": jitter_s}
    at_end = {"back_s": exposure_s / 2 + 0.005 - 1 / 32, "std_s": arrival["std_s"]}
    for driver, place, wanted in [
        (b"uvcvideo", BufferFlag.STAMP_AT_START, arrival),
        (b"imx", BufferFlag.STAMP_AT_START, start),
        (b"imx", 0, at_end),
    ]:
        plugged.driver, plugged.stamp = driver, BufferFlag.MONOTONIC | place
        plugged.stamp_offset_s = 0.0 if place else 1 / 32
        camera = opened(plugged, context, transfer_us=10_000.0)
        try:
            frame = camera.grab(1.0)
        finally:
            camera.close()
        begun_s = plugged.begun_s + frame.sequence / 32
        assert frame.middle_s == pytest.approx(begun_s - wanted["back_s"], abs=2e-6)
        assert frame.middle_std_s == pytest.approx(wanted["std_s"])


def test_an_exposure_that_nobody_tells_is_no_longer_than_a_frame(plugged, context):
    plugged.controls = {}
    camera = opened(plugged, context, exposure_us=None, gain=None)
    frame = camera.grab(1.0)
    camera.close()
    assert np.isnan([frame.exposure_us, frame.middle_s, frame.middle_std_s]).all()
    assert frame.exposed_s == pytest.approx(plugged.begun_s + (frame.sequence - 1) / 32, abs=2e-6)


def test_the_date_belongs_to_the_exposure(camera, clock):
    frame = camera.grab(1.0)
    age_s = (clock.utc() - frame.utc).total_seconds()
    assert age_s == pytest.approx(clock.now_s() - frame.exposed_s, abs=2e-6)


def test_stamps_and_grey_levels_that_cannot_be_are_refused(plugged, context):
    for change, message in [
        ({"stamp": 0}, "expected a timestamp of the monotonic clock"),
        ({"stamp_offset_s": 9.0}, "expected a frame from the past"),
        ({"level_mask": 0xFFFF, "shown": 200}, "expected grey levels of 12 bits"),
    ]:
        before = {name: getattr(plugged, name) for name in change}
        for name, value in change.items():
            setattr(plugged, name, value)
        camera = opened(plugged, context)
        try:
            with pytest.raises(DeviceFault, match=message):
                camera.grab(1.0)
        finally:
            camera.close()
        for name, value in before.items():
            setattr(plugged, name, value)


def test_frames_that_are_all_too_old_are_told_from_none(plugged, context):
    camera = opened(plugged, context, transfer_us=1e7)
    with pytest.raises(DeviceTimeout, match=r"got none but [1-9]\d older; allow more time"):
        camera.grab(2.0)
    camera.close()
