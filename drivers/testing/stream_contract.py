"""Tests that every camera driver with a method ``stream`` must pass."""

from itertools import pairwise

import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.interfaces import Frame
from drivers.streams.losses import LossKind
from drivers.streams.stream import StreamReport
from drivers.testing.camera_bench import GRAB_S, ROUNDS, CameraBench
from drivers.testing.common import needed, wait_until

CERTAIN = (LossKind.GAP, LossKind.DAMAGED, LossKind.OVERFLOW)


class StreamContract:
    """Tests of streams. `CameraContract` contains them; cameras without a method ``stream`` skip them."""

    def test_a_stream_is_in_order_and_has_the_camera_to_itself(self, bench: CameraBench) -> None:
        """Frames of a stream must be in order, and `grab` must be refused while the stream is open."""
        asked_s = bench.clock.now_s()
        with bench.stream() as stream:
            frames = [stream.next(GRAB_S) for _ in range(2 * ROUNDS)]
            for call in (lambda: bench.camera.grab(GRAB_S), bench.stream):
                with pytest.raises(DeviceFault) as refused:
                    call()
                bench.assert_says_all(refused.value)
        assert frames[0].exposed_s >= asked_s
        for before, after in pairwise(frames):
            assert before.sequence < after.sequence
            assert before.exposed_s < after.exposed_s
        bench.grab()

    def test_a_stream_accounts_for_every_frame(self, bench: CameraBench) -> None:
        """A stream must also report the frames that were dropped because the queue was full."""
        with bench.stream(capacity=2) as stream:
            wait_until(lambda: stream.report().lost > 2, SystemClock(), GRAB_S)
            frames = [stream.next(GRAB_S) for _ in range(ROUNDS)]
        frames += list(stream)  # take the frames that are still in the queue of the stream
        assert _told_missing(frames, stream.report())

    def test_a_stream_tells_of_lost_frames(self, bench: CameraBench) -> None:
        """A stream must report the frames that are missing in the camera's frame numbers."""
        lose = needed(bench.lose, "lose frames")
        with bench.stream() as stream:
            frames = [stream.next(GRAB_S) for _ in range(ROUNDS)]
            lose()
            wait_until(lambda: stream.report().lost > 0, SystemClock(), GRAB_S)
            frames += [stream.next(GRAB_S) for _ in range(stream.report().taken)]
        frames += list(stream)
        assert _told_missing(frames, stream.report())

    def test_a_stream_without_room_is_refused(self, bench: CameraBench) -> None:
        """A stream whose queue has a capacity below 1 must be refused, because every frame would be lost."""
        for capacity in (0, -1):
            with pytest.raises(DeviceFault) as refused:
                bench.stream(capacity=capacity)
            bench.assert_says_all(refused.value)
        bench.grab()

    def test_closing_the_camera_ends_its_stream(self, bench: CameraBench) -> None:
        """After the camera is closed, a stream must give its queued frames first and then raise an error."""
        stream = bench.stream()
        stream.next(GRAB_S)
        bench.camera.close()
        taken = 1 + len(list(stream))
        assert taken == stream.report().taken
        with pytest.raises(DeviceTimeout) as ended:
            stream.next(GRAB_S)
        bench.assert_says_all(ended.value)


def _told_missing(frames: list[Frame], report: StreamReport) -> set[int]:
    """Return the missing frame numbers from a stream's report, between the first and the last taken frame."""
    assert report.taken == len(frames)
    numbers = {frame.sequence for frame in frames}
    span = set(range(min(numbers), max(numbers)))
    losses = [loss for loss in report.losses if loss.kind in CERTAIN]
    told = {loss.first + i for loss in losses for i in range(loss.count)} & span
    assert span - numbers == told
    return told
