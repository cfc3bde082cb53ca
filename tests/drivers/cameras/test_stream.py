"""Streams of the simulated kernel's camera. Its pictures show their numbers, so lost ones are known."""

import threading

import numpy as np
import pytest

from drivers.cameras.v4l2.camera import V4l2Camera, open_camera
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.clock import VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.streams.losses import LossKind
from drivers.streams.stream import FrameStream
from tests.drivers.cameras.fake_kernel import FakeCamera, FakeSystem

DEADLINE_S = 60.0


def opened(plugged: FakeCamera, context: OpenContext) -> V4l2Camera:
    settings = V4l2Settings(
        device="/dev/video0", format="Y16", width_px=32, height_px=20, rate_hz=32.0, exposure_us=1000.0
    )
    return open_camera(settings, context, FakeSystem([plugged]))


def take(stream: FrameStream, count: int) -> list[int]:
    """Return the numbers of the received pictures."""
    return [(int(stream.next(DEADLINE_S).image[0, 0]) - 11) // 37 for _ in range(count)]


def lost(stream: FrameStream, *kinds: LossKind) -> set[int]:
    """Return the sequence numbers that the stream reports as missing."""
    losses = [loss for loss in stream.report().losses if loss.kind in kinds]
    return {number for loss in losses for number in range(loss.first, loss.first + loss.count)}


@pytest.fixture
def plugged() -> FakeCamera:
    return FakeCamera(VirtualClock(), level_mask=0xFFFF)


@pytest.fixture
def context(plugged: FakeCamera) -> OpenContext:
    return OpenContext("camera", plugged.clock)


def test_of_a_thousand_frames_each_lost_one_is_reported(plugged, context):
    rng = np.random.default_rng(5)
    kinds = rng.choice(["", "lost", "damaged", "short"], 1200, p=[0.95, 0.03, 0.01, 0.01])
    plugged.frame_faults = {number: str(kind) for number, kind in enumerate(kinds) if kind and number > 10}
    plugged.first_counter = 2**32 - 300  # the kernel's counter goes round under way
    camera = opened(plugged, context)
    with camera.stream(capacity=1200) as stream:
        shown = take(stream, 1000)
    report = stream.report()
    camera.close()
    span = range(shown[0], shown[-1] + 1)
    bad = {number for number in span if number in plugged.frame_faults}
    assert 30 < len(bad) < 80
    assert shown == [number for number in span if number not in bad]
    offset = plugged.first_counter
    until = offset + shown[-1] + 1
    reported = lost(stream, LossKind.GAP, LossKind.DAMAGED)
    assert {number - offset for number in reported if number < until} == bad
    kinds_until = {loss.kind for loss in report.losses if loss.first < until}
    assert kinds_until == {LossKind.GAP, LossKind.DAMAGED}


def test_what_does_not_fit_into_the_queue_is_reported(plugged, context):
    camera = opened(plugged, context)
    with camera.stream(capacity=8) as stream:
        while stream.report().lost < 30:
            pass
    report = stream.report()
    shown = take(stream, 8)
    camera.close()
    assert report.taken == 8
    assert np.diff(shown).tolist() == [1] * 7
    overflow = [loss for loss in report.losses if loss.kind is LossKind.OVERFLOW]
    assert len(overflow) == 1
    assert overflow[0].first == shown[-1] + 1


def test_frames_that_the_camera_did_not_count_are_missed_by_their_time(plugged, context):
    plugged.frame_faults = {10: "uncounted"}
    camera = opened(plugged, context)
    with camera.stream() as stream:
        shown = take(stream, 30)
    camera.close()
    found = [(loss.kind, loss.count) for loss in stream.report().losses[:2]]
    assert found == [(LossKind.GAP, 1), (LossKind.PAUSE, 3)]
    assert stream.report().losses[1].first == stream.report().losses[0].first + 1
    assert 10 not in shown


def test_frames_that_come_late_now_and_then_are_not_missing(plugged, context):
    rng = np.random.default_rng(8)
    late = {*rng.choice(400, 100).tolist(), *range(200, 220)}
    plugged.frame_faults = {number: "late" for number in late if number > 10}
    camera = opened(plugged, context)
    with camera.stream(capacity=500) as stream:
        take(stream, 400)
    camera.close()
    assert [loss for loss in stream.report().losses if loss.kind is not LossKind.OVERFLOW] == []


def test_a_counter_that_stands_still_is_reported(plugged, context):
    plugged.frame_faults = {10: "repeat"}
    camera = opened(plugged, context)
    with camera.stream() as stream:
        shown = take(stream, 20)
    camera.close()
    first = stream.report().losses[0]
    assert (first.kind, first.count) == (LossKind.REPEAT, 0)
    assert 10 in shown


def test_a_restart_of_the_stream_is_seen_as_a_gap(plugged, context):
    plugged.frame_faults = {10: "broken"}
    camera = opened(plugged, context)
    with camera.stream() as stream:
        shown = take(stream, 20)
    camera.close()
    first = stream.report().losses[0]
    assert first.kind is LossKind.GAP
    assert first.count >= 1
    assert 10 not in shown


def test_the_error_that_ends_a_stream_comes_after_the_frames_before_it(plugged, context):
    camera = opened(plugged, context)
    stream = camera.stream()
    take(stream, 5)
    plugged.present = False
    with pytest.raises(LinkLost, match="unplugged camera"):
        take(stream, 1000)
    assert (plugged.open_nodes, plugged.mapped) == (0, 0)
    stream.close()
    plugged.present = True
    assert camera.grab(1.0).flags == 0
    camera.close()
    assert plugged.open_nodes == 0


def test_a_stalled_camera_ends_the_stream(plugged, context):
    camera = opened(plugged, context)
    stream = camera.stream()
    take(stream, 5)
    plugged.stalled = True
    with pytest.raises(DeviceTimeout, match="stream: expected a frame within 1 s, got none"):
        take(stream, 1000)
    camera.close()
    assert not any(thread.name.startswith("stream") for thread in threading.enumerate())


def test_a_stream_has_the_camera_to_itself_until_it_is_closed(plugged, context):
    camera = opened(plugged, context)
    with camera.stream() as stream:
        for call in (lambda: camera.grab(1.0), camera.stream):
            with pytest.raises(DeviceFault, match="expected no open stream"):
                call()
        for taken, _ in enumerate(stream):
            if taken == 10:
                stream.close()
    assert camera.grab(1.0).flags == 0
    camera.close()
    with pytest.raises(DeviceTimeout, match="none, since the stream was closed"):
        take(stream, 1000)


def test_whatever_ends_the_thread_is_raised_for_whoever_takes_the_frames(plugged):
    def source(timeout_s: float) -> None:
        raise ValueError("not foreseen")

    stream = FrameStream("camera", source, plugged.clock, interval_s=1.0, silence_s=1.0, on_close=list)
    with pytest.raises(ValueError, match="not foreseen"):
        stream.next(float("inf"))
    stream.close()


def test_closing_an_old_stream_again_leaves_the_new_one_alone(plugged, context):
    camera = opened(plugged, context)
    old = camera.stream()
    old.close()
    with camera.stream() as new:
        old.close()
        with pytest.raises(DeviceFault, match="expected no open stream"):
            camera.grab(1.0)
        take(new, 3)
    camera.close()


def test_every_close_waits_until_the_camera_is_let_go(plugged):
    asked, going = threading.Event(), threading.Event()

    def source(timeout_s: float) -> None:
        asked.set()
        going.wait(DEADLINE_S)

    stream = FrameStream("camera", source, plugged.clock, interval_s=1.0, silence_s=1.0, on_close=list)
    asked.wait(DEADLINE_S)
    closers = [threading.Thread(target=stream.close) for _ in range(2)]
    for closer in closers:
        closer.start()
    closers[1].join(0.05)
    assert all(closer.is_alive() for closer in closers)
    going.set()
    for closer in closers:
        closer.join()
    assert not stream._thread.is_alive()
