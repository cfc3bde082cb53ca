"""The Aravis driver reads back all settings that it writes, and refuses a camera that has other values."""

import math

import pytest

from drivers.errors import DeviceFault, LinkLost
from tests.drivers.cameras.aravis.opening import opened


@pytest.mark.parametrize(
    ("keeps", "message"),
    [
        ({"ExposureAuto": "Continuous"}, "set ExposureAuto: expected Off, got Continuous on reading back"),
        ({"format": "Mono8"}, "set format: expected Mono12, got Mono8"),
        ({"region": (0, 0, 16, 16)}, r"set size: expected 32 x 16 px at \(0, 0\), got 16 x 16 px"),
        ({"frame_rate": 30.0}, "set frame_rate: expected 32, got 30"),
        ({"exposure_time": 4900.0}, "set exposure_time: expected 5000, got 4900"),
        ({"gain": 1.9}, "set gain: expected 2, got 1.9"),
    ],
)
def test_what_is_read_back_otherwise_is_refused(keeps, message, library, context):
    library.keeps = keeps
    with pytest.raises(DeviceFault, match=message):
        opened(library, context)
    assert library.held == 0


def test_a_setting_that_another_one_changes_is_refused(library, context):
    library.camera_set_gain = lambda gain: library.values.update(gain=gain, exposure_time=100.0)
    with pytest.raises(DeviceFault, match="verify exposure_time: expected 5000, got 100"):
        opened(library, context)
    assert library.held == 0


def test_a_setting_that_another_program_changes_is_noticed(library, context):
    camera = opened(library, context, gain=None)
    assert camera.grab(1.0).gain == 3.0
    library.values["gain"] = 6.0
    with pytest.raises(DeviceFault, match="verify gain: expected 3, got 6"):
        camera.grab(1.0)
    camera.close()
    assert math.isclose(library.values["exposure_time"], 5000.0)


def test_a_camera_that_answers_no_number_is_not_believed(library, context):
    camera = opened(library, context)
    library.values["exposure_time"] = math.nan
    with pytest.raises(DeviceFault, match="verify exposure_time: expected 5000, got nan"):
        camera.grab(1.0)
    camera.close()


def test_an_automatic_that_must_stay_on_may_be_accepted(library, context):
    library.keeps = {"ExposureAuto": "Continuous"}
    camera = opened(library, context, features={"ExposureAuto": "Continuous"})
    assert camera.grab(1.0).flags == 0
    camera.close()
    assert library.values["ExposureAuto"] == "Continuous"


def test_no_trigger_is_left_on(library, context):
    cleared = []
    library.camera_clear_triggers = lambda: cleared.append(1)
    opened(library, context).close()
    assert cleared == [1]


def test_a_camera_in_other_hands_is_left_alone(library, context):
    library.controlled = True
    with pytest.raises(LinkLost, match="expected a free camera, got one that another program controls"):
        opened(library, context)
    assert library.held == 0
    assert library.values["ExposureAuto"] == "Continuous"
