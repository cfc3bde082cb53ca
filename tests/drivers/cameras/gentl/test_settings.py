"""The GenTL driver reads back all settings that it writes, and refuses a camera that has other values."""

import pytest

from drivers.cameras.gentl.settings import GentlSettings
from drivers.errors import DeviceFault, LinkLost
from tests.drivers.cameras.fake_gentl import HEIGHT, INTERVAL_S, WIDTH, FakeProducer, opened

LINES = {"LineSelector": "Line1", "LineMode": "Input", "LineSource": "Off"}
USER = {"UserOutputSelector": "UserOutput0", "UserOutputValue": True}
TRIGGER = {"TriggerSelector": "AcquisitionStart", "TriggerMode": "On", "TriggerSource": "Line3"}


def test_everything_is_set_and_read_back(plugged, context):
    camera = opened(plugged, context, offset_x_px=16, features={"ExposureAuto": "Once"})
    assert {name: plugged.values[name] for name in ("ExposureAuto", "AcquisitionMode")} == {
        "ExposureAuto": "Once",
        "AcquisitionMode": "Continuous",
    }
    assert plugged.values["AcquisitionFrameRateEnable"] is True
    plugged.values["Gain"] = 2.5
    assert camera.read_settings() == {
        "format": "Mono12",
        "offset_x_px": 16,
        "offset_y_px": 0,
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "exposure_us": 5000.0,
        "rate_hz": 1 / INTERVAL_S,
        "gain": 2.5,
        "feature_exposure_auto": "Once",
        "feature_device_firmware_version": "1.7",
    }
    camera.close()


@pytest.mark.parametrize(
    ("keeps", "message"),
    [
        ({"ExposureAuto": "Continuous"}, "set ExposureAuto: expected Off, got Continuous on reading back"),
        ({"PixelFormat": "Mono8"}, "set PixelFormat: expected Mono12, got Mono8 on reading back"),
        ({"Width": 16}, r"set size: expected 32 x 16 px at \(0, 0\), got 16 x 16 px at \(0, 0\)"),
        ({"AcquisitionFrameRate": 30.0}, "set AcquisitionFrameRate: expected 32, got 30 on reading back"),
        ({"ExposureTime": 4900.0}, "set ExposureTime: expected 5000, got 4900"),
        ({"Gain": 1.9}, "set Gain: expected 2, got 1.9"),
    ],
)
def test_what_is_read_back_otherwise_is_refused(keeps, message, plugged, context):
    plugged.keeps = keeps
    producer = FakeProducer(plugged)
    with pytest.raises(DeviceFault, match=message):
        opened(producer, context)
    assert (plugged.connections, producer.users) == (0, 0)


def test_a_setting_that_another_program_changes_is_noticed(plugged, context):
    camera = opened(plugged, context, gain=None)
    assert camera.grab(1.0).gain == 3.0
    plugged.values["Gain"] = 6.0
    with pytest.raises(DeviceFault, match="verify Gain: expected 3, got 6; open the camera again"):
        camera.grab(1.0)
    camera.close()


def test_names_from_before_the_standard_are_known(plugged, context):
    for old, new in (("ExposureTimeAbs", "ExposureTime"), ("GainRaw", "Gain")):
        plugged.values[old] = plugged.values.pop(new)
    camera = opened(plugged, context)
    frame = camera.grab(1.0)
    assert (frame.exposure_us, frame.gain) == (5000.0, 2.0)
    camera.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exposure_us": None}, "set exposure_us: expected an exposure time, got none; give exposure_us"),
        ({"features": {"Sharpness": "Off"}}, "expected a feature of the camera, got 'Sharpness'"),
        ({"features": {"GainAuto": "Refused"}}, "set GainAuto: expected acceptance, got Feature 'GainAuto'"),
    ],
)
def test_what_the_camera_does_not_take_is_refused(changes, message, plugged, context):
    plugged.values["GainAuto"] = "Off"
    with pytest.raises(DeviceFault, match=message):
        opened(plugged, context, **changes)
    assert plugged.connections == 0


def test_triggers_are_off_unless_one_is_named(plugged, context):
    plugged.values |= TRIGGER
    plugged.selected = {"TriggerSelector": ("AcquisitionStart", "FrameStart")}
    opened(plugged, context).close()
    assert plugged.values["TriggerMode"] == "Off"
    plugged.values["TriggerActivation"] = "LevelHigh"
    camera = opened(plugged, context, trigger="Line1", transfer_us=0.0)
    assert {name: plugged.values[name] for name in (*TRIGGER, "TriggerActivation")} == {
        "TriggerSelector": "FrameStart",
        "TriggerMode": "On",
        "TriggerSource": "Line1",
        "TriggerActivation": "RisingEdge",
    }
    # the first triggered frame is an image; of a camera that runs freely, two are thrown away
    assert camera.grab(1.0).sequence == plugged.first_number
    assert camera.read_settings()["trigger_source"] == "Line1"
    camera.close()


def test_the_program_gives_pulses_on_a_line(plugged, context, clock):
    plugged.values |= LINES | USER
    camera = opened(plugged, context, output="Line2", output_source="UserOutput1", pulse_ms=20.0)
    assert [plugged.values[name] for name in LINES] == ["Line2", "Output", "UserOutput1"]
    plugged.switched.clear()
    camera.pulse()
    clock.sleep(0.1)
    (on_s, _, on), (off_s, _, off) = plugged.switched
    assert (on, off) == (True, False)
    assert off_s - on_s == pytest.approx(0.02)
    plugged.gone = True
    with pytest.raises(LinkLost, match="got Device has been removed"):
        camera.pulse()
    plugged.gone = False
    camera.close()
    assert plugged.values["UserOutputValue"] is False


def test_one_producer_or_several_may_be_named():
    picture = {"camera": "S1", "width_px": 32, "height_px": 16, "rate_hz": 10.0}
    for given, wanted in ((None, []), ("one.cti", ["one.cti"]), (["one.cti", "two"], ["one.cti", "two"])):
        settings = GentlSettings.model_validate(picture | ({} if given is None else {"cti": given}))
        assert settings.cti == wanted
