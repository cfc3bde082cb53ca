"""Tests that every camera driver must pass."""

import math
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path
from random import Random
from types import FrameType

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import Camera, Frame
from drivers.testing.camera_bench import GRAB_S, ROUNDS, TINY_S, CameraBench
from drivers.testing.common import ANSWER_S, Handle, assert_identified, assert_settings, needed, wait_until
from drivers.testing.stream_contract import StreamContract

PAUSES, PAUSE_S = 0.3, 1e-3
"""Fraction of a driver's calls and returns at which a thread pauses, and the longest pause in seconds."""
BYTE_BITS = 8
SURE_STD = 3.0
"""The middle of an exposure is never farther from the truth than this number of standard deviations."""


class CameraContract(StreamContract):
    """Tests of a camera: inherit from this class and define a fixture `bench`.

    The fixture yields a `CameraBench`, and closes the camera after the test.
    """

    def test_tells_who_it_is(self, bench: CameraBench) -> None:
        """The camera must report its identity, because the run file contains the identity."""
        assert_identified(bench.camera.info)

    def test_images_are_of_the_announced_format(self, bench: CameraBench) -> None:
        """A frame must have the size, the data type and the significant bits that `info` gives."""
        info = bench.camera.info
        frame = bench.grab()
        assert frame.flags == 0
        assert frame.image.shape == (info.height_px, info.width_px)
        assert frame.image.dtype == (np.uint8 if info.bits <= BYTE_BITS else np.uint16)
        assert 0 < int(frame.image.max()) < 1 << info.bits

    def test_settings_are_read_back(self, bench: CameraBench) -> None:
        """A camera that offers settings must report size, exposure time and gain as its frames have them."""
        found = assert_settings(needed(getattr(bench.camera, "read_settings", None), "read settings"))
        info = bench.camera.info
        assert (found["width_px"], found["height_px"]) == (info.width_px, info.height_px)
        for name in ("exposure_us", "gain"):
            if name in found:
                assert found[name] == pytest.approx(getattr(bench, name), rel=1e-3)
        bench.grab()

    def test_settings_of_a_closed_camera_are_an_error(self, bench: CameraBench) -> None:
        """A closed camera must raise an error instead of reporting settings."""
        read = needed(getattr(bench.camera, "read_settings", None), "read settings")
        bench.camera.close()
        with pytest.raises(DeviceError) as closed:
            read()
        bench.assert_says_all(closed.value)

    def test_tells_exposure_and_gain(self, bench: CameraBench) -> None:
        """A frame must give exposure time in µs and gain in the camera's unit. An unknown value is NaN."""
        frame = bench.grab()
        assert frame.exposure_us == pytest.approx(bench.exposure_us, nan_ok=True)
        assert frame.gain == pytest.approx(bench.gain, nan_ok=True)

    def test_the_middle_of_the_exposure_is_within_the_times_of_the_frame(self, bench: CameraBench) -> None:
        """The middle must lie between start and arrival, and near the truth if the test camera tells it."""
        for _ in range(3):
            frame = bench.grab()
            middle_s, std_s = frame.middle
            assert frame.exposed_s - TINY_S <= middle_s <= frame.received_s + TINY_S
            assert 0.0 <= std_s < math.inf
            assert math.isnan(frame.middle_s) == math.isnan(frame.middle_std_s)
            if bench.shows is not None and not math.isnan(frame.exposure_us):
                true_s = bench.shows(frame) + frame.exposure_us * 1e-6 / 2
                assert abs(middle_s - true_s) <= SURE_STD * std_s + TINY_S

    def test_a_frame_was_exposed_after_the_call_whatever_the_pause(self, bench: CameraBench) -> None:
        """After a pause, `grab` must not return an old frame, which shows an earlier state of the
        specimen."""
        bench.grab()
        for pause in (0.0, 0.3, 0.9, 7.6, 40.1):
            bench.clock.sleep(pause * bench.interval_s)
            bench.grab()

    def test_frames_are_numbered_and_dated(self, bench: CameraBench) -> None:
        """Frame numbers must increase, and `utc` of a frame must be the date and time of its start of
        exposure."""
        frames = [bench.grab() for _ in range(3)]
        late_s = (bench.clock.utc() - frames[-1].utc).total_seconds()
        age_s = bench.clock.now_s() - frames[-1].exposed_s
        assert late_s == pytest.approx(age_s, abs=bench.tolerance_s)
        assert all(before.sequence < after.sequence for before, after in pairwise(frames))

    def test_a_frame_stays_as_it_was(self, bench: CameraBench) -> None:
        """The image of a frame must not change when later frames arrive."""
        first = bench.grab()
        kept = first.image.copy()
        later = [bench.grab() for _ in range(ROUNDS)]
        np.testing.assert_array_equal(first.image, kept)
        assert not any(np.shares_memory(first.image, frame.image) for frame in later)

    def test_a_deadline_that_cannot_be_kept_is_told_in_time(self, bench: CameraBench) -> None:
        """A timeout that is too short must raise an error in time. The camera must stay usable."""
        for timeout_s in (0.0, -1.0, math.nan, bench.interval_s / 4):
            # repeat, because after a pause of this computer, the next frame may be due within the timeout
            assert any(bench.grab() and bench.times_out(timeout_s) for _ in range(ROUNDS))
        bench.grab()

    def test_a_camera_that_gives_nothing_is_told_in_time_and_used_again(self, bench: CameraBench) -> None:
        """If no frames come, `grab` must end in time; later the camera must work again without being
        reopened."""
        stall, go_on = needed(bench.stall, "stall"), needed(bench.go_on, "go on")
        bench.grab()
        stall()
        for _ in range(2):
            bench.assert_times_out(10 * bench.interval_s)
        go_on()
        bench.grab()

    def test_calls_from_two_threads_do_not_mix(self, bench: CameraBench) -> None:
        """When two threads call `grab` at the same time, each thread must get frames exposed after its own
        call."""
        # make many rounds, because a race between threads shows only by chance
        rounds, together = 3 * ROUNDS, threading.Barrier(2)

        def grabs() -> list[Frame]:
            together.wait(ANSWER_S)
            return [bench.grab() for _ in range(rounds)]

        with _giving_way(bench.camera), ThreadPoolExecutor(2) as pool:
            both = [each.result() for each in [pool.submit(grabs) for _ in range(2)]]
        for frames in both:
            assert all(before.sequence < after.sequence for before, after in pairwise(frames))
        assert len({frame.sequence for frames in both for frame in frames}) == 2 * rounds

    def test_may_be_closed_while_another_thread_grabs(self, bench: CameraBench) -> None:
        """If the camera is closed during a `grab` of another thread, that thread gets a frame or an error."""
        grabbing, closed = threading.Event(), threading.Event()

        def grabs() -> None:
            while not closed.is_set():
                bench.grab()
                grabbing.set()

        with ThreadPoolExecutor(1) as pool:
            ended = pool.submit(grabs)
            assert grabbing.wait(ANSWER_S)
            bench.camera.close()
            closed.set()
            error = ended.exception(ANSWER_S)
        assert error is None or isinstance(error, DeviceError), error
        if error is not None:
            bench.assert_says_all(error)

    def test_closing_twice_is_harmless_and_the_end(self, bench: CameraBench) -> None:
        """A closed camera must refuse all calls, and opening the camera again must be possible."""
        bench.grab()
        bench.camera.close()
        bench.camera.close()
        calls: list[Handle] = [lambda: bench.camera.grab(GRAB_S)]
        if hasattr(bench.camera, "stream"):
            calls.append(bench.stream)
        for call in calls:
            with pytest.raises(DeviceError) as refused:
                call()
            bench.assert_says_all(refused.value)
        with closing(bench.reopen()) as again:
            assert again.grab(GRAB_S).flags == 0

    def test_nothing_is_left_of_a_closed_camera(self, bench: CameraBench) -> None:
        """A closed camera must leave no threads, file descriptors or camera resources open."""
        bench.camera.close()
        threads, descriptors = _threads(), _descriptors()
        for _ in range(3):
            with closing(bench.reopen()) as camera:
                camera.grab(GRAB_S)
                if hasattr(camera, "stream"):
                    camera.stream().next(GRAB_S)
            assert bench.held is None or bench.held() == 0
        # wait, because a simulator in this process needs time to close its end of the connection
        wait_until(lambda: _threads() <= threads, SystemClock(), ANSWER_S)
        wait_until(lambda: _descriptors() <= descriptors, SystemClock(), ANSWER_S)


@contextmanager
def _giving_way(camera: Camera) -> Iterator[None]:
    """Make new threads pause at many of the driver's calls and returns, so that other threads run.

    A profile function makes the pauses, because a trace function would replace that of a debugger or of a
    coverage tool.
    """
    modules = {each.__module__ for each in type(camera).__mro__}
    theirs = {name for name in modules if name.partition(".")[0] not in sys.stdlib_module_names}
    # a driver may be a package with several modules, so let the threads pause in all of them
    packages = tuple(name.rpartition(".")[0] or name for name in theirs)
    clock, chance, before = SystemClock(), Random(1), threading.getprofile()

    def of_driver(frame: FrameType | None) -> bool:
        return frame is not None and str(frame.f_globals.get("__name__")).startswith(packages)

    def give_way(frame: FrameType, *_: object) -> None:
        if (of_driver(frame) or of_driver(frame.f_back)) and chance.random() < PAUSES:
            clock.sleep(chance.uniform(0.0, PAUSE_S))

    threading.setprofile(give_way)
    try:
        yield
    finally:
        threading.setprofile(before)


def _threads() -> int:
    return len(threading.enumerate())


def _descriptors() -> int:
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.is_dir() else 0
