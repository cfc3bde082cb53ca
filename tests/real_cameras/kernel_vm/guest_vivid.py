"""Tests of the camera driver with the kernel's virtual camera vivid, in the virtual machine."""

import itertools
import statistics
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.cameras.v4l2.abi import BufferFlag
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.streams.losses import LossKind
from tests.real_cameras.kernel_vm.guest import AT_START, CLOCK, OPENED, left_open, opened, turn, watched

BLACK, WHITE = 5, 6  # of vivid's menu of test patterns
NO_TEXT = 2
FRAMES = 1000
LOST_PERCENT = 5


@pytest.fixture(autouse=True)
def reset() -> Iterator[None]:
    for knob in ("Percentage of Dropped Buffers", "Wrap Sequence Number", "Test Pattern"):
        turn(knob, 0)
    turn("OSD Text Mode", NO_TEXT)
    yield
    left = left_open()
    while OPENED:
        OPENED.pop().close()
    assert left == []


def test_all_formats_arrive_at_full_depth() -> None:
    # vivid shifts its 8 bits to the upper end of the deeper formats
    factors = {"GREY": 1, "Y10": 4, "Y12": 16, "Y16": 256}
    found = {}
    for code in (*factors, "YUYV"):
        camera = opened(format=code)
        levels = []
        for pattern in (BLACK, WHITE):
            turn("Test Pattern", pattern, camera=camera)
            image = camera.grab(5.0).image
            assert image.min() == image.max()
            levels.append(int(image[0, 0]))
        camera.close()
        assert image.dtype == (np.uint8 if camera.info.bits == 8 else np.uint16)
        found[code] = levels
    grey = found["GREY"]
    assert 0 <= grey[0] < 20 < 230 < grey[1] <= 255
    for code, factor in factors.items():
        assert found[code] == [level * factor for level in grey]
    assert found["YUYV"][0] < 20 < 230 < found["YUYV"][1]


def test_rows_are_cut_by_their_stride() -> None:
    images = []
    for stride in (0, 1024):
        camera = opened(format="Y16", stride_bytes=stride)
        assert camera._session._picture.stride == (stride or 640)
        images.append(camera.grab(5.0).image)
        camera.close()
    assert np.ptp(images[0]) > 10_000
    np.testing.assert_array_equal(*images)


def test_what_the_kernel_answers_instead_is_refused() -> None:
    for changes, message in [
        ({"width_px": 650, "height_px": 470}, r"expected 650 x 470 px GREY, got 6[0-9]+ x [0-9]+ px GREY"),
        ({"rate_hz": 1000.0}, r"set frame rate: expected 1000 Hz, got \d+ Hz"),
        ({"exposure_us": 5000.0}, "got no exposure control; leave out `exposure_us`"),
        ({"gain": 256}, "set gain: expected 0 to 255 in steps of 1, got 256"),
        ({"input": 7}, "choose input: expected input 7"),
        ({"device": "/dev/video9"}, r"got no such device \(ENOENT\)"),
        ({"device": "/dev/null"}, r"identify camera: .*does not know the request \(ENOTTY\)"),
        ({"device": "bus:platform:vivid-007"}, "expected one camera 'bus:platform:vivid-007', got none"),
    ]:
        with pytest.raises((DeviceFault, LinkLost), match=message):
            opened(**changes)
        assert [name for name in left_open() if "maps" in name] == []


def test_is_found_by_its_bus_and_says_who_it_is() -> None:
    camera = opened("bus:platform:vivid-001")
    camera.close()
    assert (camera.info.vendor, camera.info.serial) == ("vivid", "platform:vivid-001")
    assert camera.info.simulated


def test_a_camera_in_use_is_not_opened_twice() -> None:
    first = opened()
    with pytest.raises(
        DeviceFault, match=r"claim camera: .*a camera in use \(EBUSY\); end the other program"
    ):
        opened(format="Y16")
    first.close()
    opened(format="Y16").close()


def test_gain_is_set_its_automatic_off_and_no_other_program_may_change_it() -> None:
    camera = opened(gain=42)
    assert camera.grab(5.0).gain == 42
    with pytest.raises(OSError, match="busy"):
        turn("Gain", 43)
    turn("Gain", 43, camera=camera)
    with pytest.raises(DeviceFault, match="verify gain: expected 42, as it was set, got 43"):
        camera.grab(5.0)
    camera.close()


def test_the_picture_is_newer_than_the_call_after_any_pause() -> None:
    camera = opened()
    camera.grab(5.0)  # before the first one, two are not used
    seen = watched(camera)
    waits_s, begins_s = [], []
    pattern, levels = BLACK, {WHITE: 255, BLACK: 0}
    for pause_s in (0.0, 0.01, 0.05, 0.2, 1.5) * 3:
        CLOCK.sleep(pause_s)
        # what is to be seen changes just before the call: an old frame would show the other
        pattern = WHITE + BLACK - pattern
        turn("Test Pattern", pattern, camera=camera)
        seen.clear()
        asked_s = CLOCK.now_s()
        frame = camera.grab(5.0)
        waits_s.append(CLOCK.now_s() - asked_s)
        begins_s.append(frame.exposed_s - asked_s)
        assert frame.exposed_s >= asked_s
        assert abs(int(frame.image.mean()) - levels[pattern]) < 25
        # by the kernel's stamps none of those that were passed over would have done
        assert [filled.stamp_s for filled in seen[:-1] if filled.stamp_s >= asked_s] == []
    camera.close()
    median_s = statistics.median(waits_s)
    print(
        f"fresh frame at 30 Hz: median {median_s * 1e3:.0f} ms, longest {max(waits_s) * 1e3:.0f} ms; "
        f"by the kernel's stamps begun {statistics.median(begins_s) * 1e3:.0f} ms after the call"
    )
    assert median_s <= 1.5 / 30


def test_a_stamp_at_the_end_of_a_frame_is_no_excuse() -> None:
    camera = opened(controls={"timestamp_source": 0})
    for pattern, level in ((WHITE, 255), (BLACK, 0)):
        turn("Test Pattern", pattern, camera=camera)
        asked_s = CLOCK.now_s()
        frame = camera.grab(5.0)
        assert frame.exposed_s >= asked_s
        assert abs(int(frame.image.mean()) - level) < 25
    camera.close()


def test_of_a_thousand_frames_every_lost_one_is_reported() -> None:
    camera = opened(rate_hz=50.0, buffers=16)
    turn("Percentage of Dropped Buffers", LOST_PERCENT, camera=camera)
    with camera.stream(capacity=2000) as stream:
        frames = []
        while not frames or frames[-1].sequence - frames[0].sequence < FRAMES:
            frames.append(stream.next(5.0))
    camera.close()
    first, last = frames[0], frames[-1]
    span = last.sequence - first.sequence + 1
    missing = set(range(first.sequence, last.sequence)) - {frame.sequence for frame in frames}
    losses = [loss for loss in stream.report().losses if first.sequence < loss.first < last.sequence]
    gaps = [loss for loss in losses if loss.kind is LossKind.GAP]
    reported = {loss.first + i for loss in gaps for i in range(loss.count)}
    print(f"{span} frames, {len(missing)} lost, {len(reported)} of them reported; other findings:", end=" ")
    print([(loss.kind.name, loss.first, loss.count) for loss in losses if loss.kind is not LossKind.GAP])
    assert reported == missing
    # at most four standard deviations of the binomial distribution fewer; a machine under load loses its own
    assert len(missing) / span > LOST_PERCENT / 100 - 4 * np.sqrt(0.05 * 0.95 / span)
    # the kernel's own clock agrees with the counter
    assert (last.exposed_s - first.exposed_s) * 50 == pytest.approx(span - 1, rel=0.01)


def test_the_kernels_counter_may_go_round() -> None:
    turn("Wrap Sequence Number", 1)  # begins 128 before the end of 32 bits
    camera = opened(rate_hz=60.0)
    with camera.stream() as stream:
        sequences = [stream.next(5.0).sequence for _ in range(160)]
    camera.close()
    assert sequences[0] < 2**32 < sequences[-1]
    jumps = [loss for loss in stream.report().losses if loss.kind is LossKind.GAP and loss.count > 100]
    assert jumps == []


def test_every_fault_ends_in_its_error_and_is_over_when_its_cause_is() -> None:
    rows = []

    def row(fault: str, outcome: str) -> None:
        rows.append(f"{fault:28} {outcome}")

    camera = opened(controls=AT_START, format="Y12")
    turn("Percentage of Dropped Buffers", 100, camera=camera)
    asked_s = CLOCK.now_s()
    with pytest.raises(DeviceTimeout) as late:
        camera.grab(0.5)
    assert CLOCK.now_s() - asked_s < 1.0
    row("camera stalls", str(late.value))
    turn("Percentage of Dropped Buffers", 0, camera=camera)
    assert camera.grab(5.0).flags == 0

    with camera.stream() as stream:
        stream.next(5.0)
        turn("Inject V4L2_BUF_FLAG_ERROR", camera=camera)
        assert [stream.next(5.0).flags for _ in range(10)] == [0] * 10
        assert LossKind.DAMAGED in {loss.kind for loss in stream.report().losses}
    row("frame damaged", "reported as damaged, not delivered")

    turn("Inject VIDIOC_QBUF Error", camera=camera)
    assert [camera.grab(5.0).flags & BufferFlag.ERROR for _ in range(6)] == [0] * 6
    row("QBUF fails", "buffer offered again, no frame lost by it")

    turn("Inject Fatal Streaming Error", camera=camera)
    assert camera.grab(5.0).flags == 0
    row("stream breaks (EIO)", "restarted, a frame within the deadline")

    with camera.stream() as stream:
        seen = watched(camera)
        frames = [stream.next(5.0) for _ in range(3)]
        turn("Inject Fatal Streaming Error", camera=camera)
        frames += [stream.next(5.0) for _ in range(10)]
    counters = [filled.sequence for filled in seen]
    assert min(after - before for before, after in itertools.pairwise(counters)) < 0
    # the kernel counts from 0 again: time tells what was missed, which is nothing if the restart was quick
    gaps = {loss.first: loss.count for loss in stream.report().losses if loss.kind is LossKind.GAP}
    for before, after in itertools.pairwise(frames):
        missed = after.sequence - before.sequence - 1
        assert missed == gaps.get(before.sequence + 1, 0)
    # both ends and the restart may each be half a frame off, and a stamp late by as much as a frame
    taken_s = frames[-1].exposed_s - frames[0].exposed_s
    assert frames[-1].sequence - frames[0].sequence == pytest.approx(taken_s * 30, abs=2.5)
    row("the same while streaming", "restarted, a gap reported as long as time tells")
    camera.close()

    for knob, step in [
        ("Inject VIDIOC_REQBUFS Error", "get buffers"),
        ("Inject VIDIOC_STREAMON Error", "start"),
    ]:
        turn(knob)
        with pytest.raises(DeviceFault) as refused:
            opened()
        assert f": {step}: " in str(refused.value)
        row(knob.removeprefix("Inject VIDIOC_").replace("Error", "fails"), str(refused.value))
        opened().close()

    print("\n" + "\n".join(rows))


def test_an_unplugged_camera_is_named_and_taken_again_when_it_is_back() -> None:
    camera = opened("bus:platform:vivid-000")
    camera.grab(5.0)
    turn("Disconnect", camera=camera)
    asked_s = CLOCK.now_s()
    with pytest.raises(LinkLost, match=r"get frame: .*unplugged camera \(ENODEV\); plug the camera in again"):
        camera.grab(5.0)
    assert CLOCK.now_s() - asked_s < 2.0
    # vivid comes back when the last one has let go of it, which the driver must have done
    assert left_open() == []
    assert camera.grab(5.0).flags == 0
    camera.close()


def test_a_camera_that_was_taken_away_and_put_back_is_found() -> None:
    bound = Path("/sys/bus/platform/drivers/vivid")
    camera = opened("bus:platform:vivid-001")
    camera.grab(5.0)
    with camera.stream() as stream:
        stream.next(5.0)
        (bound / "unbind").write_text("vivid.0")
        with pytest.raises(LinkLost):
            for _ in stream:
                pass
    with pytest.raises(LinkLost, match="got none; plug the camera in"):
        camera.grab(5.0)
    (bound / "bind").write_text("vivid.0")
    assert camera.grab(5.0).flags == 0
    camera.close()
