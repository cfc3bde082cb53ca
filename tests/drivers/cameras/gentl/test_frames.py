"""The GenTL driver delivers new frames with honest times, counts them, and flags what is not whole."""

import math

import numpy as np
import pytest

from drivers.cameras.gentl.session import INCOMPLETE, OTHER_SIZE, REPEATED
from drivers.errors import DeviceFault
from drivers.streams.losses import LossKind
from tests.drivers.cameras.fake_gentl import CLOCK, EXPOSURE_S, INTERVAL_S, TRANSFER_S, opened

DEADLINE_S = 60.0


@pytest.mark.parametrize("pause_s", [0.0, 0.05, 10.0])
def test_a_frame_that_waited_in_a_buffer_is_not_taken(pause_s, plugged, context, clock):
    camera = opened(plugged, context, format="Mono16")
    camera.grab(1.0)
    clock.sleep(pause_s)
    asked_s = clock.now_s()
    frame = camera.grab(1.0)
    begun_s = plugged.begun(int(frame.image[0, 0]))
    assert asked_s <= frame.exposed_s <= begun_s
    # looked for every millisecond; the driver does not know how much of a frame time the transfer takes
    assert begun_s - frame.exposed_s <= INTERVAL_S - TRANSFER_S + 0.0011
    camera.close()
    assert plugged.connections == 0


def test_the_middle_is_within_the_time_that_the_transfer_may_take(plugged, context):
    camera = opened(plugged, context, transfer_us=4000.0)
    for _ in range(5):
        frame = camera.grab(1.0)
        true_s = plugged.begun(int(frame.image[0, 0])) + EXPOSURE_S / 2
        assert abs(frame.middle_s - true_s) <= 0.0026
        assert frame.middle_std_s == pytest.approx(math.hypot(0.005 / math.sqrt(12), 5e-4), rel=0.01)
    camera.close()


def test_without_an_exposure_time_the_middle_is_unknown(plugged, context):
    for name in ("ExposureTime", "ExposureAuto", "Gain"):
        del plugged.values[name]
    camera = opened(plugged, context, exposure_us=None, gain=None)
    frame = camera.grab(1.0)
    assert np.isnan([frame.exposure_us, frame.gain, frame.middle_s, frame.middle_std_s]).all()
    assert frame.exposed_s <= frame.received_s - 2 * INTERVAL_S
    camera.close()


def test_the_cameras_own_clock_tells_the_exposure(plugged, context, clock):
    plugged.values |= CLOCK
    camera = opened(plugged, context, stamp="start", format="Mono16")
    for pause_s in (0.0, 3.0, 60.0):
        clock.sleep(pause_s)
        frame = camera.grab(1.0)
        true_s = plugged.begun(int(frame.image[0, 0]))
        assert frame.exposed_s <= true_s <= frame.exposed_s + 0.002
        assert abs(frame.middle_s - true_s - EXPOSURE_S / 2) <= math.sqrt(3) * frame.middle_std_s
    plugged.stamps = False
    with pytest.raises(DeviceFault, match="expected a time stamp of the camera, got none; leave out `stamp`"):
        camera.grab(1.0)
    camera.close()


def test_a_stamp_from_the_future_is_refused(plugged, context):
    plugged.values |= CLOCK
    camera = opened(plugged, context, stamp="start")
    camera.grab(1.0)
    told = plugged.camera_s
    plugged.camera_s = lambda time_s: told(time_s + 0.5)
    with pytest.raises(DeviceFault, match=r"exposure lies 0\.4\d+ s after its arrival; correct `stamp`"):
        camera.grab(1.0)
    camera.close()


def test_frames_that_are_not_whole_carry_flags_and_a_stream_tells_of_them(plugged, context):
    camera = opened(plugged, context, format="Mono16")
    plugged.faults = {20: "lost", 30: "incomplete", 40: "small"}
    with camera.stream(capacity=200) as stream:
        shown = [int(stream.next(DEADLINE_S).image[0, 0]) for _ in range(50)]
    told = {(loss.kind, loss.first, loss.count) for loss in stream.report().losses if loss.first < 45}
    # the number of a picture is one less than that of the camera's counter
    assert told == {(LossKind.GAP, 21, 1), (LossKind.DAMAGED, 31, 1), (LossKind.DAMAGED, 41, 1)}
    assert not {20, 30, 40} & set(shown)
    plugged.faults = dict.fromkeys(range(5000), "incomplete")
    assert camera.grab(1.0).flags == INCOMPLETE
    plugged.faults = dict.fromkeys(range(5000), "small")
    frame = camera.grab(1.0)
    assert (frame.flags, frame.image.any()) == (OTHER_SIZE, False)
    camera.close()


def test_a_picture_that_comes_again_is_flagged(plugged, context):
    camera = opened(plugged, context)
    camera.grab(1.0)
    whole = plugged.picture
    plugged.picture = lambda shown: whole(5)
    assert camera.grab(1.0).flags == REPEATED
    camera.close()


def test_the_counter_of_16_bits_goes_round_without_a_loss(plugged, context):
    plugged.first_number = 65535 - 20
    camera = opened(plugged, context, format="Mono16")
    with camera.stream(capacity=200) as stream:
        sequences = [stream.next(DEADLINE_S).sequence for _ in range(60)]
    camera.close()
    assert np.diff(sequences).tolist() == [1] * 59
    assert sequences[0] < 65535 < sequences[-1]


def test_a_producer_without_frame_numbers_is_counted(plugged, context):
    plugged.numberless = True
    camera = opened(plugged, context, format="Mono16")
    with camera.stream(capacity=200) as stream:
        sequences = [stream.next(DEADLINE_S).sequence for _ in range(20)]
    camera.close()
    assert np.diff(sequences).tolist() == [1] * 19


def test_grey_levels_beyond_the_format_are_refused(plugged, context, clock):
    camera = opened(plugged, context)
    clock.sleep(4096 * INTERVAL_S)
    with pytest.raises(DeviceFault, match=r"expected grey levels of 12 bits, got 4\d+; choose format Mono16"):
        camera.grab(1.0)
    camera.close()
