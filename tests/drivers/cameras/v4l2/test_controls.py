"""The V4L2 driver switches automatic controls off, sets exposure and gain, and notices changes of both."""

import errno

import numpy as np
import pytest

from drivers.cameras.v4l2.abi import NEXT_CONTROL, ControlFlag, ControlId, RequestCode
from drivers.errors import DeviceFault
from tests.drivers.cameras.fake_kernel import FakeControl, FakeNode
from tests.drivers.cameras.v4l2.opening import EXPOSURE_US, opened


def test_switches_every_automatic_off_and_reads_back(camera, plugged):
    controls = plugged.controls
    for automatic, off in [
        (ControlId.EXPOSURE_AUTO, 1),
        (ControlId.EXPOSURE_AUTO_PRIORITY, 0),
        (ControlId.AUTO_WHITE_BALANCE, 0),
        (ControlId.POWER_LINE_FREQUENCY, 0),
    ]:
        assert controls[automatic].value == off
    assert controls[ControlId.EXPOSURE_ABSOLUTE].value == 100  # of 100 µs each, by the kernel's documentation
    frame = camera.grab(1.0)
    assert (frame.exposure_us, frame.gain) == (EXPOSURE_US, 4.0)


def test_a_control_that_keeps_another_value_is_refused_unless_it_is_accepted(plugged, context):
    plugged.controls[ControlId.POWER_LINE_FREQUENCY].keeps = 1
    with pytest.raises(DeviceFault, match="set power_line_frequency: expected 0, got 1 on reading back"):
        opened(plugged, context)
    opened(plugged, context, controls={"power_line_frequency": 1}).close()
    plugged.controls[ControlId.BACKLIGHT_COMPENSATION] = FakeControl(
        "Backlight Compensation", 1, flags=ControlFlag.READ_ONLY
    )
    with pytest.raises(DeviceFault, match=r"accept it: controls = \{ backlight_compensation = 1 \}"):
        opened(plugged, context, controls={"power_line_frequency": 1})


def test_an_automatic_that_cannot_be_changed_may_be_accepted(plugged, context):
    plugged.controls[ControlId.BACKLIGHT_COMPENSATION] = FakeControl(
        "Backlight Compensation", 1, flags=ControlFlag.READ_ONLY
    )
    camera = opened(plugged, context, controls={"backlight_compensation": 1})
    assert camera.grab(1.0).flags == 0
    camera.close()
    assert plugged.controls[ControlId.BACKLIGHT_COMPENSATION].value == 1


def test_an_automatic_that_is_named_is_set_before_what_it_holds(plugged, context):
    camera = opened(plugged, context, controls={"auto_exposure": 1})
    assert camera.grab(1.0).exposure_us == EXPOSURE_US
    camera.close()


def test_what_has_a_setting_of_its_own_is_no_further_control(plugged, context):
    for name, own in (("exposure_time_absolute", "exposure_us"), ("gain", "gain")):
        with pytest.raises(DeviceFault, match=f"set {name}: .*under `controls`; use the setting `{own}`"):
            opened(plugged, context, controls={name: 50})


def test_a_value_that_the_camera_does_not_know_is_named(plugged, context):
    plugged.errors[RequestCode.S_CTRL] = [errno.EINVAL]
    with pytest.raises(DeviceFault, match=r"set auto_exposure: .*EINVAL\); choose a value that the camera"):
        opened(plugged, context)


def test_a_control_that_an_automatic_holds_is_not_called_set(plugged, context):
    plugged.controls[ControlId.GAIN].flags = ControlFlag.INACTIVE
    with pytest.raises(DeviceFault, match="set gain: expected 4 in effect, got a control that an automatic"):
        opened(plugged, context)
    camera = opened(plugged, context, gain=None)
    assert np.isnan(camera.grab(1.0).gain)
    plugged.controls[ControlId.GAIN].value = 7  # as the automatic does
    assert np.isnan(camera.grab(1.0).gain)
    camera.close()


def test_a_further_control_that_an_automatic_holds_is_refused(plugged, context):
    plugged.controls[0x98091A] = FakeControl(
        "White Balance Temperature", 4000, 2800, 6500, flags=ControlFlag.INACTIVE
    )
    with pytest.raises(DeviceFault, match="set white_balance_temperature: expected 5000 in effect"):
        opened(plugged, context, controls={"white_balance_temperature": 5000})


def test_an_exposure_that_something_unknown_holds_is_refused(plugged, context):
    del plugged.controls[ControlId.EXPOSURE_AUTO]
    with pytest.raises(DeviceFault, match="set exposure_time_absolute: expected 100 in effect"):
        opened(plugged, context)


def test_an_exposure_beside_an_automatic_iris_is_in_effect(plugged, context):
    """Some cameras have no fully manual mode; uvcvideo calls the exposure inactive in all modes but that."""
    plugged.controls[ControlId.EXPOSURE_AUTO].keeps = 2
    with pytest.raises(DeviceFault, match="set auto_exposure: expected 1, got 2 on reading back"):
        opened(plugged, context)
    camera = opened(plugged, context, controls={"auto_exposure": 2})
    assert plugged.controls[ControlId.EXPOSURE_ABSOLUTE].flags & ControlFlag.INACTIVE
    assert plugged.controls[ControlId.EXPOSURE_ABSOLUTE].value == 100
    assert camera.grab(1.0).exposure_us == EXPOSURE_US
    camera.close()


def test_a_sensor_that_counts_lines_needs_their_duration(plugged, context):
    plugged.controls = {ControlId.EXPOSURE: FakeControl("Exposure", 7, 4, 4000)}
    with pytest.raises(DeviceFault, match="got exposure in lines; add `line_us`"):
        opened(plugged, context, gain=None)
    with pytest.raises(DeviceFault, match="got no gain control"):
        opened(plugged, context, line_us=20.0)
    camera = opened(plugged, context, gain=None, line_us=20.0)
    frame = camera.grab(1.0)
    camera.close()
    assert plugged.controls[ControlId.EXPOSURE].value == 500
    assert frame.exposure_us == EXPOSURE_US
    assert np.isnan(frame.gain)


def test_a_driver_that_lists_its_controls_in_a_circle_is_asked_once(plugged, context, monkeypatch):
    listed = FakeNode.queryctrl
    *ids, last = sorted(plugged.controls)
    answered = []

    def in_a_circle(node: FakeNode, query) -> None:
        goes_on = query.id & NEXT_CONTROL
        listed(node, query)
        if goes_on:
            query.id = ids[0] if query.id == last else query.id
            answered.append(query.id)

    monkeypatch.setattr(FakeNode, "queryctrl", in_a_circle)
    opened(plugged, context).close()
    assert answered == [*ids, ids[0]]


def test_a_control_that_is_disabled_is_left_alone(plugged, context):
    plugged.controls[ControlId.FOCUS_AUTO] = FakeControl("Focus", 1, flags=ControlFlag.DISABLED)
    opened(plugged, context).close()
    assert plugged.controls[ControlId.FOCUS_AUTO].value == 1


def test_a_setting_that_another_program_changes_is_noticed(camera, plugged):
    camera.grab(1.0)
    plugged.controls[ControlId.GAIN].value = 5
    with pytest.raises(DeviceFault, match="verify gain: expected 4, as it was set, got 5"):
        camera.grab(1.0)


def test_a_stream_is_not_begun_with_settings_that_another_program_changed(camera, plugged):
    plugged.controls[ControlId.GAIN].value = 5
    with pytest.raises(DeviceFault, match="verify gain: expected 4, as it was set, got 5"):
        camera.stream()
    plugged.controls[ControlId.GAIN].value = 4
    assert camera.grab(1.0).flags == 0
