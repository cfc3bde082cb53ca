"""Trigger input, output line and the camera's own clock, through Aravis."""

import math
from itertools import pairwise

import pytest

from drivers.cameras.aravis.settings import AravisSettings
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.streams.losses import LossKind
from tests.drivers.cameras.aravis.opening import DEADLINE_S, opened
from tests.drivers.cameras.fake_aravis import INTERVAL_S
from tests.mistakes import mistakes_of

TRIGGER = {"TriggerSelector": "", "TriggerMode": "Off", "TriggerSource": "", "TriggerActivation": ""}
LINES = {"LineSelector": "Line1", "LineMode": "Input", "LineSource": "Off"}
USER = {"UserOutputSelector": "UserOutput0", "UserOutputValue": True}
CLOCK = {"TimestampLatch": "", "TimestampLatchValue": 0}


def test_a_trigger_input_is_set_after_the_rate_and_read_back(library, context):
    library.values |= TRIGGER
    library.camera_clear_triggers = lambda: library.values.update(TriggerMode="Off")
    rate = library.values

    def set_rate(value: float) -> None:  # as the library does
        rate.update(frame_rate=value, TriggerMode="Off")

    library.camera_set_frame_rate = set_rate
    camera = opened(library, context, trigger="Line1", trigger_edge="FallingEdge")
    assert {name: library.values[name] for name in TRIGGER} == {
        "TriggerSelector": "FrameStart",
        "TriggerMode": "On",
        "TriggerSource": "Line1",
        "TriggerActivation": "FallingEdge",
    }
    found = camera.read_settings()
    assert [found[f"trigger_{key}"] for key in ("mode", "source", "edge")] == ["On", "Line1", "FallingEdge"]
    camera.close()


def test_a_camera_without_triggers_is_not_lost_and_its_stream_goes_on(library, context, clock):
    library.values |= TRIGGER
    camera = opened(library, context, trigger="Line1", transfer_us=0.0)
    first = camera._session
    # the first triggered frame is an image; of a camera that runs freely, two are thrown away
    assert camera.grab(1.0).sequence == library.first_id + 1
    library.silent = True
    for _ in range(3):
        with pytest.raises(DeviceTimeout, match="got none"):
            camera.grab(10.0)
    assert camera._session is first
    library.silent = False
    with camera.stream() as stream:
        one = stream.next(DEADLINE_S)
        library.silent = True
        clock.sleep(30.0)
        library.silent = False
        two = stream.next(DEADLINE_S)
    assert two.sequence > one.sequence
    assert all(loss.kind is not LossKind.PAUSE for loss in stream.report().losses)
    camera.close()


def test_a_line_that_reads_back_otherwise_is_refused(library, context):
    library.values |= TRIGGER | LINES
    library.keeps = {"LineSource": "Off"}
    with pytest.raises(DeviceFault, match="set LineSource: expected ExposureActive, got Off on reading back"):
        opened(library, context, output="Line2")
    library.keeps = {"TriggerActivation": "RisingEdge"}
    with pytest.raises(DeviceFault, match="set TriggerActivation: expected FallingEdge, got RisingEdge"):
        opened(library, context, trigger="Line1", trigger_edge="FallingEdge")
    assert library.held == 0


@pytest.mark.parametrize("given", [{"trigger": "Line1"}, {"output": "Line2"}])
def test_a_camera_without_lines_says_so(given, library, context):
    with pytest.raises(DeviceFault, match=r"expected a camera with .*, got none; leave the setting out"):
        opened(library, context, **given)
    assert library.held == 0


def test_the_exposure_drives_an_output_line(library, context):
    library.values |= LINES
    camera = opened(library, context, output="Line2")
    assert {name: library.values[name] for name in LINES} == {
        "LineSelector": "Line2",
        "LineMode": "Output",
        "LineSource": "ExposureActive",
    }
    assert camera.read_settings()["output_source"] == "ExposureActive"
    with pytest.raises(DeviceFault, match="pulse: expected an output line that the program drives"):
        camera.pulse()
    camera.close()


def test_the_program_gives_pulses_while_a_stream_is_open(library, context, clock):
    library.values |= LINES | USER
    camera = opened(library, context, output="Line2", output_source="UserOutput1", pulse_ms=20.0)
    # at rest after opening, whatever was there before
    assert library.values["UserOutputValue"] is False
    with camera.stream() as stream:
        stream.next(DEADLINE_S)
        library.switched.clear()
        camera.pulse()
        # time goes on with the stream, so the pulse may be over already
        clock.sleep(0.1)
        (on_s, name, on), (off_s, _, off) = library.switched
    assert (name, on, off) == ("UserOutputValue", True, False)
    assert library.values["UserOutputSelector"] == "UserOutput1"
    assert off_s - on_s == pytest.approx(0.02)
    camera.close()
    assert library.values["UserOutputValue"] is False
    with pytest.raises(LinkLost, match="pulse: expected an opened camera"):
        camera.pulse()


def test_a_camera_that_does_not_answer_gives_no_pulse(library, context):
    library.values |= LINES | USER
    camera = opened(library, context, output="Line2", output_source="UserOutput1")
    library.gone = True
    with pytest.raises(LinkLost, match="expected an answer of the camera, got Device not found"):
        camera.pulse()
    library.gone = False
    camera.close()


@pytest.mark.parametrize(("stamp", "early_s"), [("start", 0.0), ("end", 0.005)])
def test_the_cameras_own_clock_tells_the_exposure(stamp, early_s, library, context, clock):
    """Its clock goes wrong by 40 µs in each second, and is read with an error of half a millisecond."""
    library.values |= CLOCK
    camera = opened(library, context, stamp=stamp, format="Mono16")
    for pause_s in (0.0, 1.0, 5.0, 60.0, 0.0):
        clock.sleep(pause_s)
        asked_s = clock.now_s()
        frame = camera.grab(1.0)
        stamped_s = library.begun_s + (frame.sequence - 1) * INTERVAL_S
        assert frame.exposed_s >= asked_s
        assert frame.exposed_s <= stamped_s - early_s <= frame.exposed_s + 0.002
        assert abs(frame.middle_s - (stamped_s - early_s + 0.0025)) <= math.sqrt(3) * frame.middle_std_s
        assert frame.middle_std_s < 1e-3
    camera.close()


def test_a_clock_that_is_read_again_and_again_is_known_better(library, context, clock):
    library.values |= CLOCK
    camera = opened(library, context, stamp="start", format="Mono16")
    widths = []
    for _ in range(400):
        widths.append(camera.grab(1.0).middle_std_s)
    # the difference in speed is known after ten seconds; before, it may be a tenth of a millisecond in each
    assert max(widths[-60:]) < max(widths[:60])
    camera.close()


def test_a_camera_whose_clock_cannot_be_read_is_refused(library, context):
    with pytest.raises(DeviceFault, match=r"read the camera's clock: .*leave out `stamp`"):
        opened(library, context, stamp="start")
    assert library.held == 0


def test_the_middle_of_a_frame_without_the_cameras_clock_is_within_its_transfer(library, context):
    camera = opened(library, context)
    for before, after in pairwise([camera.grab(1.0) for _ in range(3)]):
        assert after.middle_s > before.middle_s
    arrived_s = library.begun_s + (after.sequence - 1) * INTERVAL_S
    assert after.middle_s == pytest.approx(arrived_s - 0.0025 - INTERVAL_S / 2, abs=1e-5)
    assert after.middle_std_s == pytest.approx(math.hypot(INTERVAL_S / math.sqrt(12), 5e-4))
    camera.close()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"trigger_edge": "RisingEdge"}, "trigger_edge needs trigger"),
        ({"pulse_ms": 5.0}, "need output"),
        ({"output": "Line1", "trigger": "Line1"}, "different lines"),
    ],
)
def test_lines_that_make_no_sense_are_refused(given, message):
    picture = {"camera": "G1", "width_px": 32, "height_px": 16, "rate_hz": 10.0, "exposure_us": 100.0}
    (mistake,) = mistakes_of(AravisSettings, picture | given)
    assert message in mistake
