"""The settings that a camera reports are those in the camera, whatever the rig file says."""

from contextlib import closing

import pytest

from drivers.cameras.opencv.camera import OpencvCamera
from drivers.cameras.opencv.settings import OpencvCameraSettings
from drivers.cameras.v4l2.abi import ControlId
from drivers.clock import VirtualClock
from drivers.errors import LinkLost
from drivers.interfaces import OpenContext
from tests.drivers.cameras.aravis import opening as aravis
from tests.drivers.cameras.fake_aravis import FakeLibrary
from tests.drivers.cameras.fake_kernel import FakeCamera
from tests.drivers.cameras.fake_opencv import FakeCapture
from tests.drivers.cameras.v4l2 import opening as v4l2


def test_v4l2_reports_format_rate_and_every_control_that_it_has_set(
    clock: VirtualClock, context: OpenContext
):
    plugged = FakeCamera(clock)
    with closing(v4l2.opened(plugged, context)) as camera:
        found = camera.read_settings()
        assert (found["format"], found["stride_bytes"]) == ("Y12", 64)
        assert found["rate_hz"] == 32.0
        plugged.controls[ControlId.GAIN].value = 9
        plugged.controls[ControlId.EXPOSURE_ABSOLUTE].value = 40
        found = camera.read_settings()
        # the kernel counts the exposure in units of 100 µs
        assert (found["gain"], found["exposure_us"]) == (9, 4000.0)
        controls = [name for name in found if name.startswith("control_")]
        assert {"control_gain", "control_auto_exposure"} <= set(controls)


def test_aravis_reports_format_transfer_and_every_feature_that_it_has_set(
    clock: VirtualClock, context: OpenContext
):
    library = FakeLibrary(clock)
    library.values["DeviceFirmwareVersion"] = "1.7"
    with closing(aravis.opened(library, context)) as camera:
        library.values |= {"gain": 5.0, "exposure_time": 4000.0, "ExposureAuto": "Once"}
        found = camera.read_settings()
        assert (found["format"], found["packet_bytes"], found["rate_hz"]) == ("Mono12", 1400, 32.0)
        assert (found["gain"], found["exposure_us"]) == (5.0, 4000.0)
        assert found["feature_exposure_auto"] == "Once"
        assert found["feature_device_firmware_version"] == "1.7"


def test_aravis_that_does_not_answer_is_an_error(clock: VirtualClock, context: OpenContext):
    library = FakeLibrary(clock)
    with closing(aravis.opened(library, context)) as camera:
        library.gone = True
        with pytest.raises(LinkLost, match="read settings: expected its settings, got Device not found"):
            camera.read_settings()


def test_opencv_reports_every_property_that_it_has_set(clock: VirtualClock, context: OpenContext):
    capture = FakeCapture(clock)
    settings = OpencvCameraSettings(
        source=0, width_px=32, height_px=20, rate_hz=25.0, gain=3.0, properties={"BRIGHTNESS": 7.0}
    )
    with closing(OpencvCamera(settings, context, capture)) as camera:
        assert camera.read_settings() == {
            "width_px": 32,
            "height_px": 20,
            "rate_hz": 25.0,
            "property_gain_raw": 3.0,
            "property_brightness_raw": 7.0,
        }
