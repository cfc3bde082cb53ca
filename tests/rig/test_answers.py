"""A driver that returns what it cannot have read is told in one sentence."""

import math
import re
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from drivers.errors import DeviceError, DeviceFault
from rig.answers import checked, require_identity
from rig.threads import Bounded, error_of_driver
from tests.rig.conftest import FakeCamera, FakeStage

AGE = [
    (math.nan, "one made at the time nan"),
    (math.inf, "one made at the time inf"),
    (-5.0, "one made 5.000 s before"),
    (3600.0, "one made 3600.000 s later"),
]


@pytest.mark.parametrize(("age_s", "got"), AGE)
def test_reading_with_an_impossible_time_is_refused(clock, age_s, got):
    clock.sleep(10.0)
    stage = FakeStage(clock, [], on_read=lambda state: replace(state, time_s=state.time_s + age_s))
    with pytest.raises(DeviceFault, match=f"^stage: read: expected .*, got {got}; mend"):
        checked("stage", "stage", stage, clock).read()


@pytest.mark.parametrize("value", [None, [], 3.0])
@pytest.mark.parametrize("kind", ["stage", "load_frame", "interlock", "camera"])
def test_value_of_another_kind_is_refused(clock, kind, value):
    class Device:
        def read(self):
            return value

        def grab(self, timeout_s):
            return value

    device = checked(kind, "one", Device(), clock)
    with pytest.raises(DeviceFault, match=r"^one: (read|grab): expected a .*(State|Frame), got "):
        device.grab(1.0) if kind == "camera" else device.read()


@pytest.mark.parametrize(
    ("changes", "got"),
    [
        ({"exposed_s": math.nan}, "one exposed at the time nan"),
        ({"exposed_s": 3600.0}, "one exposed 3599.980 s later"),
        ({"received_s": math.nan}, "one received at the time nan"),
        ({"received_s": 7.02}, "one received 7.000 s later"),
    ],
)
def test_image_with_an_impossible_time_is_refused(clock, changes, got):
    camera = FakeCamera(clock, on_grab=lambda _, frame: replace(frame, **changes))
    with pytest.raises(DeviceFault, match=f"^one: grab: expected .*, got {got}; mend"):
        checked("camera", "one", camera, clock).grab(1.0)


def test_good_values_are_passed_on_and_so_is_every_other_method(clock):
    stage = checked("stage", "stage", FakeStage(clock, []), clock)
    stage.move_to(80.0)
    assert stage.read().moving
    assert stage.info == FakeStage.info
    assert checked("camera", "one", FakeCamera(clock), clock).grab(1.0).sequence == 1


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"angle_deg": "45"}, "expected a finite number as angle_deg, got a str"),
        ({"angle_deg": math.nan}, "expected a finite number as angle_deg, got nan"),
        ({"moving": None}, "expected True or False as moving, got None"),
        ({"time_s": None}, "expected a number as time_s, got None"),
        ({"warnings": "NI"}, "expected a tuple of texts as warnings, got a str"),
    ],
)
def test_state_with_a_value_of_another_kind_is_refused(clock, changes, said):
    stage = FakeStage(clock, [], on_read=lambda state: replace(state, **changes))
    with pytest.raises(DeviceFault, match=f"^stage: read: {said}; mend"):
        checked("stage", "stage", stage, clock).read()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"image": [[1, 2]]}, "expected a picture of grey levels as image, got a list"),
        ({"utc": datetime(2026, 1, 1)}, "expected a date and time with its zone.* as utc"),
        ({"sequence": None}, "expected a whole number as sequence, got None"),
        ({"exposure_us": "1"}, "expected a number as exposure_us, got a str"),
    ],
)
def test_image_with_a_value_of_another_kind_is_refused(clock, changes, said):
    camera = FakeCamera(clock, on_grab=lambda _, frame: replace(frame, **changes))
    with pytest.raises(DeviceFault, match=f"^one: grab: {said}"):
        checked("camera", "one", camera, clock).grab(1.0)


def test_numbers_of_numpy_become_those_of_python(clock):
    numbers = {"angle_deg": np.float32(0.5), "moving": np.bool_(True)}
    stage = FakeStage(clock, [], on_read=lambda state: replace(state, **numbers))
    state = checked("stage", "stage", stage, clock).read()
    assert (type(state.angle_deg), type(state.moving)) == (float, bool)


def test_error_of_a_driver_of_another_package_stays_what_it_is():
    class CableOut(DeviceError):
        pass

    CableOut.__module__ = "acme.driver"
    error = CableOut("stage", "read", "an answer", "none", "plug the cable in")
    assert error_of_driver("stage", "read", error) is error


def test_device_without_its_description_is_refused():
    for device in (None, object()):
        with pytest.raises(DeviceFault, match="expected a device with a DeviceInfo as info"):
            require_identity("stage", "stage", device)
    require_identity("operator", "operator", object())


class WithoutWords(Exception):
    def __str__(self):
        raise ValueError


@pytest.mark.parametrize(
    ("error", "got"),
    [
        (ZeroDivisionError("a bug"), r"ZeroDivisionError \(a bug\)"),
        (RuntimeError("one\n\x1b[2Jtwo"), r"RuntimeError \(one \[2Jtwo\)"),
        (GeneratorExit(), "GeneratorExit"),
        (WithoutWords(), "WithoutWords"),
    ],
)
def test_exception_that_is_no_device_error_is_one_sentence(error, got):
    said = str(error_of_driver("stage", "read", error))
    words = "stage: read: expected a call that returns or raises a DeviceError, got a driver that raises"
    assert re.fullmatch(f"{words} {got}; mend the driver", said)


@pytest.mark.parametrize("ending", [SystemExit(0), KeyboardInterrupt()])
def test_driver_that_ends_the_program_fails_the_run_instead(rotation, ending):
    def end(state):
        raise ending

    rotation.stage.on_read = end
    outcome = rotation.engine().run()
    assert outcome.status == "failed"
    assert outcome.reason.startswith(
        "stage: read: expected a call that returns or raises a DeviceError, got a driver"
    )
    with pytest.raises(DeviceError, match="a driver that ends the program"):
        Bounded("stage", "open", lambda: end(None)).result(60.0, "")


def test_stage_that_loses_its_reference_position_ends_the_run(rotation, at_step):
    at_step(2, lambda: setattr(rotation.stage, "homed", False))
    outcome = rotation.engine().run()
    assert outcome.status == "failed"
    assert "expected a stage with its reference position, got one that has lost it" in outcome.reason
    assert outcome.steps_done <= 4
    assert rotation.calls[-1] == "stop"


@pytest.mark.parametrize(
    ("changes", "got"),
    [
        ({"exposed_s": math.nan}, "exposed at the time nan"),
        ({"middle_s": math.inf, "middle_std_s": 0.0}, "one at the time inf"),
        ({"middle_s": 7.02, "middle_std_s": 0.0}, "one 7.000 s later"),
        ({"middle_s": 0.01, "middle_std_s": math.nan}, "got nan"),
    ],
)
def test_frames_of_a_stream_are_checked_too(clock, changes, got):
    class Stream:
        def next(self, timeout_s):
            return replace(FakeCamera(clock).grab(timeout_s), **changes)

    class Streaming(FakeCamera):
        def stream(self, capacity):
            return Stream()

    assert not hasattr(checked("camera", "one", FakeCamera(clock), clock), "stream")
    with pytest.raises(DeviceFault, match=f"^one: stream: expected .*{got}; mend"):
        checked("camera", "one", Streaming(clock), clock).stream(8).next(1.0)
