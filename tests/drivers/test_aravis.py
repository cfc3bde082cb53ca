"""The Aravis driver's refusals, with a library of the tests' own in place of libaravis."""

import math
import threading
from datetime import timedelta

import numpy as np
import pytest

from drivers.aravis import AravisCamera
from drivers.aravis_session import OTHER_SIZE
from drivers.aravis_settings import AravisSettings
from drivers.clock import VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.frame_losses import LossKind
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from tests.drivers.fake_aravis import HEIGHT, INTERVAL_S, MISSING_PACKETS, WIDTH, FakeLibrary

PATIENCE_S = 20.0
"""Of the machine's clock, for what happens aside; nothing waits so long unless it is wrong."""


def settings(**changes: object) -> AravisSettings:
    values = {
        "camera": "G1",
        "format": "Mono12",
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "rate_hz": 1 / INTERVAL_S,
        "exposure_us": 5000.0,
        "gain": 2.0,
    }
    return AravisSettings.model_validate(values | changes)


@pytest.fixture
def library(clock: VirtualClock) -> FakeLibrary:
    clock.sleep(100.0)
    return FakeLibrary(clock)


def opened(library: FakeLibrary, context: OpenContext, **changes: object) -> AravisCamera:
    return AravisCamera(settings(**changes), context, library)  # type: ignore[arg-type]


def test_switches_automatics_off_reads_back_and_films_fresh_frames(library, context, clock):
    camera = opened(library, context)
    assert library.values["ExposureAuto"] == "Off"
    for pause_s in (0.0, 0.05, 10.0):
        clock.sleep(pause_s)
        asked_s = clock.now_s()
        frame = camera.grab(1.0)
        begun_s = library.begun_s + int(frame.image[0, 0]) * INTERVAL_S
        # the first packet comes an exposure and at most a frame time after the exposure began
        assert frame.exposed_s == pytest.approx(begun_s - 0.005 - INTERVAL_S, abs=1e-5)
        assert frame.exposed_s >= asked_s
        assert (frame.flags, frame.exposure_us, frame.gain) == (0, 5000.0, 2.0)
    camera.close()
    assert library.held == 0
    assert (camera.info.bits, find_driver("aravis").kind) == (12, "camera")


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


def test_a_setting_that_another_program_changes_is_noticed(library, context):
    camera = opened(library, context, gain=None)
    assert camera.grab(1.0).gain == 3.0
    library.values["gain"] = 6.0
    with pytest.raises(DeviceFault, match="verify gain: expected 3, got 6"):
        camera.grab(1.0)
    camera.close()
    assert math.isclose(library.values["exposure_time"], 5000.0)


def test_damaged_frames_and_frames_of_another_size_carry_flags(library, context):
    camera = opened(library, context)
    library.status = dict.fromkeys(range(1000), MISSING_PACKETS)
    assert camera.grab(1.0).flags == MISSING_PACKETS
    library.status = {}
    library.size = (WIDTH, HEIGHT // 2)
    assert camera.grab(1.0).flags == OTHER_SIZE
    camera.close()


def test_a_silent_camera_is_opened_anew_and_another_one_in_its_place_refused(library, context):
    camera = opened(library, context)
    library.silent = True
    with pytest.raises(DeviceTimeout, match=r"grab: .* within 0\.5 s, got none; check cable"):
        camera.grab(0.5)
    library.gone = True
    with pytest.raises(LinkLost, match="expected the camera with serial number G1, got Device not found"):
        camera.grab(PATIENCE_S)
    library.gone = library.silent = False
    library.serial = "G2"
    with pytest.raises(LinkLost, match="got the camera with serial number G2"):
        camera.grab(PATIENCE_S)
    library.serial, library.taken = "G1", -1
    assert camera.grab(PATIENCE_S).flags == 0
    camera.close()
    assert library.held == 0
    assert not any(thread.name.startswith("close") for thread in threading.enumerate())


def test_the_counter_of_16_bits_goes_round_without_a_loss(library, context):
    library.first_id = 65535 - 20
    camera = opened(library, context)
    with camera.stream() as stream:
        sequences = [stream.next(PATIENCE_S).sequence for _ in range(60)]
    camera.close()
    assert np.diff(sequences).tolist() == [1] * 59
    assert sequences[0] < 65535 < sequences[-1]
    gaps = [loss for loss in stream.report().losses if loss.kind is not LossKind.OVERFLOW]
    assert gaps == []


def test_a_picture_that_waited_stays_old_when_the_date_is_set_back(library, context, clock):
    camera = opened(library, context)
    for _ in range(3):
        camera.grab(1.0)
    for step in (timedelta(seconds=-2), timedelta(seconds=2)):
        clock.sleep(1.5)
        waiting = library.stream_try_pop_buffer(2)
        old = {waiting: library.buffer_get_system_timestamp(waiting)}
        clock._start += step
        library.waiting, library.dated = [waiting], old
        asked_s = clock.now_s()
        frame = camera.grab(1.0)
        assert library.waiting == []
        assert library.begun_s + int(frame.image[0, 0]) * INTERVAL_S >= asked_s
        age_s = (clock.utc() - frame.utc).total_seconds()
        assert age_s == pytest.approx(clock.now_s() - frame.exposed_s, abs=1e-5)
    camera.close()


def test_the_counter_of_16_bits_goes_round_any_number_of_times_in_a_pause(library, context, clock):
    camera = opened(library, context, format="Mono16")
    before = camera.grab(1.0)
    for rounds in (0.6, 1.0, 7.4):
        clock.sleep(rounds * 65535 * INTERVAL_S)
        after = camera.grab(1.0)
        apart = (after.exposed_s - before.exposed_s) / INTERVAL_S
        assert after.sequence - before.sequence == round(apart)
        before = after
    camera.close()


def test_a_camera_in_other_hands_is_left_alone(library, context):
    library.controlled = True
    with pytest.raises(LinkLost, match="expected a free camera, got one that another program controls"):
        opened(library, context)
    assert library.held == 0
    assert library.values["ExposureAuto"] == "Continuous"


def test_grey_levels_beyond_the_format_are_refused_but_in_damaged_frames(library, context, clock):
    camera = opened(library, context)
    clock.sleep(4096 * INTERVAL_S)
    with pytest.raises(DeviceFault, match=r"expected grey levels of 12 bits, got 4\d+; choose format Mono16"):
        camera.grab(1.0)
    library.status = dict.fromkeys(range(9000), MISSING_PACKETS)
    assert camera.grab(1.0).flags == MISSING_PACKETS
    camera.close()


def test_a_camera_that_answers_no_number_is_not_believed(library, context):
    camera = opened(library, context)
    library.values["exposure_time"] = math.nan
    with pytest.raises(DeviceFault, match="verify exposure_time: expected 5000, got nan"):
        camera.grab(1.0)
    camera.close()


def test_a_camera_that_stops_answering_is_lost_and_found_again(library, context):
    camera = opened(library, context)
    camera.grab(1.0)
    library.gone = True
    with pytest.raises(LinkLost, match="verify frame_rate: expected 32, got Device not found; check"):
        camera.grab(1.0)
    library.gone, library.taken = False, -1
    assert camera.grab(PATIENCE_S).flags == 0
    camera.close()
    assert library.held == 0


def test_calls_keep_their_deadlines_while_a_camera_is_opened_again(library, context):
    camera = opened(library, context)
    library.silent = True
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(0.5)
    library.silent, library.taken = False, -1
    answer, opens = threading.Event(), library.camera_new
    library.camera_new = lambda name: answer.wait(PATIENCE_S) and opens(name)
    for _ in range(2):
        with pytest.raises(DeviceTimeout, match="got a connection that is still being given up or made"):
            camera.grab(0.01)
    answer.set()
    assert camera.grab(PATIENCE_S).flags == 0
    camera.close()
    assert library.held == 0


def test_a_camera_that_is_closed_while_it_is_opened_again_is_let_go(library, context):
    camera = opened(library, context)
    library.silent = True
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(0.5)
    answer, opens = threading.Event(), library.camera_new
    library.camera_new = lambda name: answer.wait(PATIENCE_S) and opens(name)
    with pytest.raises(DeviceTimeout, match="still being given up or made"):
        camera.grab(0.01)
    answer.set()
    camera.close()
    assert library.held == 0


def test_every_buffer_goes_back_and_two_frames_settle(library, context):
    camera = opened(library, context, transfer_us=0.0)
    assert library.lent == -8  # as many as are there to be filled
    assert camera.grab(1.0).sequence - library.first_id >= 2
    for _ in range(20):
        camera.grab(1.0)
    assert library.lent == -8
    camera.close()


def test_a_frame_of_less_bytes_carries_a_flag(library, context):
    camera = opened(library, context)
    library.pixels = np.zeros((HEIGHT, WIDTH - 1), np.uint16)
    frame = camera.grab(1.0)
    assert (frame.flags, frame.image.any()) == (OTHER_SIZE, False)
    camera.close()


def test_a_setting_that_another_one_changes_is_refused(library, context):
    library.camera_set_gain = lambda gain: library.values.update(gain=gain, exposure_time=100.0)
    with pytest.raises(DeviceFault, match="verify exposure_time: expected 5000, got 100"):
        opened(library, context)
    assert library.held == 0


def test_no_trigger_is_left_on(library, context):
    cleared = []
    library.camera_clear_triggers = lambda: cleared.append(1)
    opened(library, context).close()
    assert cleared == [1]


def test_an_automatic_that_must_stay_on_may_be_accepted(library, context):
    library.keeps = {"ExposureAuto": "Continuous"}
    opened(library, context, features={"ExposureAuto": "Continuous"}).close()


def test_a_camera_is_not_given_up_for_a_call_without_patience(library, context):
    camera = opened(library, context)
    opens = []
    library.camera_new = opens.append
    for timeout_s in (0.0, -1.0, math.nan, INTERVAL_S / 4):
        with pytest.raises(DeviceTimeout, match="got none"):
            camera.grab(timeout_s)
    assert camera.grab(1.0).flags == 0
    library.silent = True
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(2 * INTERVAL_S)
    assert library.held == 2
    with pytest.raises(DeviceTimeout, match="got none"):
        camera.grab(2 * INTERVAL_S)
    camera.close()
    assert (library.held, opens) == (0, [])


def test_a_call_does_not_wait_for_another_beyond_its_deadline(library, context, clock):
    camera = opened(library, context)
    asked, going, pops = threading.Event(), threading.Event(), library.stream_timeout_pop_buffer

    def slowly(stream: int, timeout_us: int) -> int:
        asked.set()
        going.wait(PATIENCE_S)
        return pops(stream, timeout_us)

    library.stream_timeout_pop_buffer = slowly
    other = threading.Thread(target=camera.grab, args=(1.0,))
    other.start()
    asked.wait(PATIENCE_S)
    with pytest.raises(DeviceTimeout, match="a camera that no other call uses, got one in use"):
        camera.grab(0.01)
    closing = threading.Thread(target=camera.close)
    closing.start()
    going.set()
    other.join()
    closing.join()
    with pytest.raises(DeviceFault, match="got a closed one"):
        camera.grab(1.0)
    assert library.held == 0


def test_only_silence_that_lasts_is_a_reason_to_open_a_camera_anew(library, context):
    interval_s = 2.0  # a camera is opened again aside, within the call's deadline by the machine's clock
    camera = opened(library, context, rate_hz=1 / interval_s, transfer_us=0.0)
    first = camera._session

    def is_silent(timeout_s: float) -> None:
        with pytest.raises(DeviceTimeout, match="got none;"):
            camera.grab(timeout_s)

    for _ in range(3):
        library.silent = True
        is_silent(2 * interval_s)
        library.silent = False
        assert camera.grab(1.0).flags == 0
    assert camera._session is first
    library.silent = True
    is_silent(4 * interval_s)
    assert camera._session is None
    is_silent(2 * interval_s)
    assert camera._session is not None
    camera.close()


def test_a_camera_whose_frames_are_all_too_old_is_not_opened_anew(library, context):
    camera = opened(library, context, transfer_us=1e7)
    first = camera._session
    for _ in range(3):
        with pytest.raises(DeviceTimeout, match=r"got none but \d+ older; allow more time"):
            camera.grab(0.5)
    assert camera._session is first
    camera.close()
