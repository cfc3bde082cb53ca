"""The simulated camera that films by itself: its beat, its streams, and their repetition."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest

from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import Frame
from drivers.streams.losses import LossKind
from simulators.rig.camera import FreeRunningCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.surroundings import Surroundings
from simulators.scene.render import render
from simulators.scene.scene import Misalignment, Scene
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.wire.faults import FaultPanel
from tests.mistakes import mistakes_of

FAST = {"width_px": 32, "height_px": 24, "fps": 50.0, "exposure_us": 8000.0, "readout_us": 25_000.0}
QUIET = {"read_noise_e": 0.0, "full_well_e": 1e12}
DEADLINE_S = 60.0


class Turning:
    """A specimen that turns by 20° per second, seen by one camera."""

    def __init__(self, clock=None, name="left", around=(), **settings):
        self.clock = clock or VirtualClock()
        self.faults = FaultPanel("camera")
        specimen = SimulatedSpecimen(SpecimenSettings())
        self.scene = Scene(
            seed=1,
            misalignment=Misalignment(),
            specimen=specimen,
            angle_deg=lambda: 20.0 * self.clock.now_s(),
            load_n=lambda: specimen.stretch_to(0.0),
        )
        settings = CameraSettings(**FAST | settings)
        around = Surroundings.of(self.clock, self.faults, **dict(around))
        self.camera = FreeRunningCamera(name, settings, self.scene, self.clock, around)

    def seen_at(self, time_s):
        """Return the noise-free picture of the specimen at a time of a new simulated clock."""
        again = Turning(**QUIET)
        again.clock.sleep(time_s)
        return render(again.camera.optics, again.scene.surface()) * 8.0 / 12.0 * 255


def test_frames_start_at_the_beat_whether_or_not_somebody_asks():
    bench = Turning(shift_us=3000.0)
    for asked_s, number in ((0.0, 0), (1.001, 50), (1.0035, 51), (7.0, 350)):
        bench.clock.sleep(max(0.0, asked_s - bench.clock.now_s()))
        asked_s = bench.clock.now_s()
        frame = bench.camera.grab(1.0)
        number = max(number, round((asked_s - 0.003) / 0.02))
        assert (frame.sequence, frame.exposed_s) == (number, 0.003 + number / 50)
        assert asked_s <= frame.exposed_s < asked_s + 0.02
        assert (frame.middle_s, frame.middle_std_s) == (pytest.approx(frame.exposed_s + 0.004), 0.0)
        assert frame.received_s == pytest.approx(frame.exposed_s + 0.033)


def test_a_frame_of_a_stream_shows_the_scene_in_the_middle_of_its_exposure():
    bench = Turning(**QUIET)
    with bench.camera.stream() as stream:
        # three frames are read out while later ones are exposed
        frames = [stream.next(DEADLINE_S) for _ in range(6)]
    for before, after in pairwise(frames):
        assert after.sequence == before.sequence + 1
        assert after.exposed_s < before.received_s
    np.testing.assert_allclose(frames[5].image, bench.seen_at(frames[5].middle_s), atol=0.51)


def recorded(deaf_s: float) -> tuple[list[Frame], list[Frame], float, int]:
    """Take frames of two cameras in turns, and sleep longer and longer between them."""
    bench = Turning()
    other = FreeRunningCamera(
        "right", CameraSettings(**FAST | {"shift_us": 7000.0}), bench.scene, bench.clock
    )
    left, right = [], []
    with bench.clock.activity(), bench.camera.stream(capacity=4) as one, other.stream() as two:
        for number in range(20):
            left.append(one.next(DEADLINE_S))
            right.append(two.next(DEADLINE_S))
            bench.clock.sleep(deaf_s * number)
        return left, right, bench.clock.now_s(), one.report().lost


@pytest.mark.parametrize("deaf_s", [0.0, 0.004])
def test_a_recording_in_simulated_time_repeats_bit_by_bit(deaf_s):
    first, again = recorded(deaf_s), recorded(deaf_s)
    assert first[2:] == again[2:]
    assert (first[3] > 0) == (deaf_s > 0)
    for ours, theirs in zip([*first[0], *first[1]], [*again[0], *again[1]], strict=True):
        assert (ours.sequence, ours.exposed_s, ours.received_s) == (
            theirs.sequence,
            theirs.exposed_s,
            theirs.received_s,
        )
        np.testing.assert_array_equal(ours.image, theirs.image)


def test_simulated_time_passes_at_the_readers_pace():
    bench = Turning()
    with bench.clock.activity(), bench.camera.stream() as stream:
        for _ in range(10):
            frame = stream.next(DEADLINE_S)
            assert bench.clock.now_s() == frame.received_s
        with pytest.raises(DeviceTimeout):
            stream.next(0.001)
        assert bench.clock.now_s() == pytest.approx(frame.received_s + 0.001)


def test_a_stream_may_be_closed_and_a_new_one_opened_within_an_activity():
    bench = Turning()
    with bench.clock.activity():
        for _ in range(3):
            with bench.camera.stream() as stream:
                first = stream.next(DEADLINE_S)
        assert bench.camera.grab(1.0).sequence > first.sequence


def test_a_stream_told_of_its_losses():
    bench = Turning()
    with bench.clock.activity(), bench.camera.stream() as stream:
        numbers = []
        for fault in ("drop:1", "corrupt:1", "stale:1"):
            numbers.append(stream.next(DEADLINE_S).sequence)
            bench.faults.switch_on(fault)
            bench.clock.sleep(0.1)
        losses = stream.report().losses
    kinds = [loss.kind for loss in losses]
    assert kinds == [LossKind.GAP, LossKind.DAMAGED, LossKind.REPEAT, LossKind.GAP]
    assert [loss.count for loss in losses] == [1, 1, 0, 1]


@pytest.mark.parametrize(("fault", "error"), [("stall", DeviceTimeout), ("unplug", LinkLost)])
def test_a_camera_that_is_gone_ends_its_stream_and_may_come_back(fault, error):
    bench = Turning()
    with bench.clock.activity():
        with bench.camera.stream() as stream:
            stream.next(DEADLINE_S)
            bench.faults.switch_on(fault)
            with pytest.raises(error):
                list(stream)
        bench.faults.clear()
        assert bench.camera.grab(1.0).flags == 0


@pytest.mark.realtime
def test_in_real_time_the_middle_is_when_the_camera_looked():
    looked = []
    bench = Turning(SystemClock(), fps=20.0)
    surface = bench.scene.surface

    def watched():
        looked.append(bench.clock.now_s())
        return surface()

    bench.scene.surface = watched
    with bench.camera.stream() as stream:
        frames = [stream.next(DEADLINE_S) for _ in range(4)]
    for frame, looked_s in zip(frames, looked[1::3], strict=False):
        assert abs(frame.middle_s - looked_s) <= frame.middle_std_s * np.sqrt(12.0)
        assert 0.0 < frame.middle_std_s < 0.05
        assert frame.exposed_s + 0.0039 <= frame.middle_s <= frame.received_s


def test_two_threads_grab_from_one_beat():
    bench = Turning()
    with ThreadPoolExecutor(2) as pool:
        both = [*pool.map(lambda _: bench.camera.grab(5.0).sequence, range(12))]
    assert len(set(both)) == 12


def test_an_exposure_longer_than_a_frame_is_refused():
    (mistake,) = mistakes_of(CameraSettings, {"fps": 200.0, "exposure_us": 8000.0})
    assert "longer than a frame" in mistake
    (mistake,) = mistakes_of(CameraSettings, {"shift_us": 10.0})
    assert "shift_us needs fps" in mistake
