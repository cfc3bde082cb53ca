"""The Aravis driver delivers new frames, counts them beyond 16 bits, and flags incomplete ones."""

from datetime import timedelta

import numpy as np
import pytest

from drivers.cameras.aravis.session import OTHER_SIZE
from drivers.errors import DeviceFault
from drivers.registry import find_driver
from drivers.streams.losses import LossKind
from tests.drivers.cameras.aravis.opening import DEADLINE_S, opened
from tests.drivers.cameras.fake_aravis import HEIGHT, INTERVAL_S, MISSING_PACKETS, WIDTH


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


def test_the_counter_of_16_bits_goes_round_without_a_loss(library, context):
    library.first_id = 65535 - 20
    camera = opened(library, context)
    with camera.stream() as stream:
        sequences = [stream.next(DEADLINE_S).sequence for _ in range(60)]
    camera.close()
    assert np.diff(sequences).tolist() == [1] * 59
    assert sequences[0] < 65535 < sequences[-1]
    gaps = [loss for loss in stream.report().losses if loss.kind is not LossKind.OVERFLOW]
    assert gaps == []


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


def test_damaged_frames_and_frames_of_another_size_carry_flags(library, context):
    camera = opened(library, context)
    library.status = dict.fromkeys(range(1000), MISSING_PACKETS)
    assert camera.grab(1.0).flags == MISSING_PACKETS
    library.status = {}
    library.size = (WIDTH, HEIGHT // 2)
    assert camera.grab(1.0).flags == OTHER_SIZE
    camera.close()


def test_a_frame_of_less_bytes_carries_a_flag(library, context):
    camera = opened(library, context)
    library.pixels = np.zeros((HEIGHT, WIDTH - 1), np.uint16)
    frame = camera.grab(1.0)
    assert (frame.flags, frame.image.any()) == (OTHER_SIZE, False)
    camera.close()


def test_grey_levels_beyond_the_format_are_refused_but_in_damaged_frames(library, context, clock):
    camera = opened(library, context)
    clock.sleep(4096 * INTERVAL_S)
    with pytest.raises(DeviceFault, match=r"expected grey levels of 12 bits, got 4\d+; choose format Mono16"):
        camera.grab(1.0)
    library.status = dict.fromkeys(range(9000), MISSING_PACKETS)
    assert camera.grab(1.0).flags == MISSING_PACKETS
    camera.close()


def test_every_buffer_goes_back_and_two_frames_settle(library, context):
    camera = opened(library, context, transfer_us=0.0)
    assert library.lent == -8  # as many as are there to be filled
    assert camera.grab(1.0).sequence - library.first_id >= 2
    for _ in range(20):
        camera.grab(1.0)
    assert library.lent == -8
    camera.close()
