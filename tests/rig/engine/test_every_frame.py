"""An acquisition of every frame, of cameras that run freely and of those that are triggered from outside."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import h5py
import numpy as np
import pytest

from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import Frame, OpenContext
from rig.devices import OpenedTrigger
from rig.engine.status import Outcome
from tests.drivers.cameras.fake_gentl import FakeDevice, opened
from tests.rig.channels.fake_box import FakeLine
from tests.rig.conftest import FakeRig
from tests.rig.engine.fake_stream import FakeLoss, FakeReport, FakeStream, StreamingCamera
from tests.rig.engine.test_acquisition import BARE, beside, steps, with_tables

EVERY = with_tables("every_frame = true", "duration_s = 10")


@dataclass
class TriggeredCamera(StreamingCamera):
    """A camera whose exposures begin at the times of its input line, `late_s` later."""

    triggers_s: tuple[float, ...] = ()
    late_s: float = 0.0
    missed: set[int] = field(default_factory=set)

    def stream(self, capacity: int) -> "TriggeredStream":
        self.opened += 1
        return TriggeredStream(self)


class TriggeredStream(FakeStream):
    """A stream that tells that it is triggered, as that of GenICam cameras."""

    def __init__(self, camera: TriggeredCamera) -> None:
        super().__init__(camera)
        self.interval_s, self.shortest_s = math.inf, 0.05
        now_s = self._clock.now_s()
        self._left = [
            (number, time_s)
            for number, time_s in enumerate(camera.triggers_s)
            if time_s >= now_s and number not in camera.missed
        ]

    def next(self, timeout_s: float) -> Frame:
        camera, clock = self._camera, self._clock
        wait_s = self._left[0][1] + camera.late_s + 0.01 - clock.now_s() if self._left else math.inf
        if wait_s > timeout_s:
            clock.sleep(timeout_s)
            raise DeviceTimeout("fake", "stream", "a frame", "none", "wait")
        clock.sleep(max(0.0, wait_s))
        number, time_s = self._left.pop(0)
        exposed_s = time_s + camera.late_s
        image = np.full((6, 8), number % 251, np.uint8)
        return Frame(
            image, exposed_s, clock.now_s(), clock.utc(), number, 0, 4000.0, 1.0, exposed_s + 0.002, 1e-4
        )


def free(tmp_path, text=EVERY, period_s=0.1) -> FakeRig:
    rig = beside(tmp_path, text)
    rig.cameras = {name: StreamingCamera(rig.clock, period_s=period_s) for name in rig.cameras}
    return rig


def triggered(tmp_path, text=EVERY, triggers_s=(), **second) -> FakeRig:
    rig = beside(tmp_path, text, lambda t: 0.0)
    first, *others = rig.cameras
    rig.cameras = {first: TriggeredCamera(rig.clock, triggers_s=tuple(triggers_s))}
    for name in others:
        rig.cameras[name] = TriggeredCamera(rig.clock, triggers_s=tuple(triggers_s), **second)
    return rig


def middles(rig: FakeRig) -> dict[str, np.ndarray]:
    with h5py.File(rig.path) as file:
        return {name: file[f"entry/instrument/{name}/middle_s"][()] for name in rig.cameras}


def test_every_frame_of_cameras_that_run_freely_is_recorded_in_pairs(tmp_path):
    rig = free(tmp_path)
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.shortfalls
    assert outcome.timing.taken == pytest.approx(100, abs=1)
    found = middles(rig)
    for middle_s in found.values():
        np.testing.assert_allclose(np.diff(middle_s), 0.1, atol=1e-9)
    np.testing.assert_allclose(*found.values(), atol=1e-9)


def test_each_trigger_gives_an_image_also_if_none_comes_for_long(tmp_path):
    """Neither the first image nor the end waits for a trigger, and silence is no fault of the camera."""
    times_s = [3.0, 3.05, 3.1, 3.5, 45.0, 58.0, 75.0]
    text = with_tables("every_frame = true", "duration_s = 60")
    rig = triggered(tmp_path, text, times_s, late_s=0.001)
    outcome = rig.engine().run()
    assert outcome.is_good, (outcome.reason, outcome.shortfalls)
    first, second = middles(rig).values()
    np.testing.assert_allclose(first, np.array(times_s[:6]) + 0.002, atol=1e-9)
    np.testing.assert_allclose(second - first, 0.001, atol=1e-9)
    assert rig.clock.now_s() < 70.0


def test_regular_triggers_that_end_are_a_fault_of_their_line(tmp_path):
    rig = triggered(tmp_path, triggers_s=np.arange(2.0, 5.01, 0.1))
    rig.cameras.popitem()
    outcome = rig.engine().run()
    assert (outcome.status, outcome.is_good, outcome.timing.taken) == ("completed", False, 31)
    # after the end of the images, the last frames are waited for
    assert outcome.timing.missing == pytest.approx((rig.clock.now_s() - 5.0) / 0.1, abs=12)
    (cause,) = outcome.timing.causes.values()
    assert cause in outcome.shortfalls
    assert "check the camera's trigger line (cameras.on_axis.trigger), its cable, the device that" in cause
    assert sum("no trigger gave a frame" in event for event in rig.events()) == 2


def test_triggers_that_come_again_are_followed_on(tmp_path):
    times_s = np.concatenate([np.arange(2.0, 4.01, 0.1), np.arange(6.0, 11.01, 0.1)])
    rig = triggered(tmp_path, triggers_s=times_s)
    outcome = rig.engine().run()
    assert outcome.timing.taken == pytest.approx(21 + 51, abs=1 + 10)
    assert outcome.timing.missing == pytest.approx(20, abs=3)


def test_a_line_that_never_gives_a_trigger_is_told_at_the_end(tmp_path):
    outcome = triggered(tmp_path).engine().run()
    assert (outcome.status, outcome.is_good) == ("completed", False)
    assert (outcome.timing.taken, outcome.timing.missing) == (0, 1)
    assert "cameras.on_axis: 1 image is missing, because no trigger gave a frame" in outcome.shortfalls[-1]


def test_triggers_of_the_rig_that_do_not_reach_the_camera_are_told(tmp_path):
    rig = triggered(tmp_path, with_tables("every_s = 0.5", "duration_s = 20"))
    rig.cameras.popitem()
    line = FakeLine(rig.clock)
    rig.triggers = {"sync": OpenedTrigger(line, "exposure")}
    outcome = rig.engine().run()
    assert (outcome.status, outcome.timing.taken, outcome.is_good) == ("completed", 0, False)
    assert outcome.timing.missing == outcome.timing.asked == 41
    assert len(line.pulses_s) > 5
    assert "(cameras.on_axis.trigger), its cable, the output triggers.sync" in outcome.shortfalls[-1]


def test_the_second_camera_may_be_the_earlier_one(tmp_path):
    rig = triggered(tmp_path, triggers_s=[2.0, 5.0, 8.0], late_s=-0.004)
    assert rig.engine().run().is_good
    first, second = middles(rig).values()
    np.testing.assert_allclose(second - first, -0.004, atol=1e-9)


def test_a_trigger_that_one_camera_misses_shifts_no_other_pair(tmp_path):
    times_s = [2.0, 2.1, 2.2, 2.3, 9.0]
    rig = triggered(tmp_path, triggers_s=times_s, missed={2})
    outcome = rig.engine().run()
    assert (outcome.status, outcome.is_good, outcome.timing.missing) == ("completed", False, 1)
    first, second = middles(rig).values()
    np.testing.assert_allclose(first, np.array([2.0, 2.1, 2.3, 9.0]) + 0.002, atol=1e-9)
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_a_triggered_camera_leads_one_that_runs_freely(tmp_path):
    rig = free(tmp_path)
    name = list(rig.cameras)[1]
    rig.cameras[name] = TriggeredCamera(rig.clock, triggers_s=(2.03, 4.0, 4.56))
    assert rig.engine().run().is_good
    free_s, triggered_s = middles(rig).values()
    np.testing.assert_allclose(triggered_s, np.array([2.03, 4.0, 4.56]) + 0.002, atol=1e-9)
    assert np.abs(free_s - triggered_s).max() <= 0.05 + 1e-9


def test_frames_that_the_stream_lost_are_missing(tmp_path):
    rig = free(tmp_path)
    camera = next(iter(rig.cameras.values()))
    camera.on_next = lambda number: setattr(
        camera, "report", FakeReport((FakeLoss(_Kind("gap"), 3 if number > 50 else 0),))
    )
    outcome = rig.engine().run()
    assert (outcome.status, outcome.timing.missing, outcome.is_good) == ("completed", 3, False)


@dataclass(frozen=True)
class _Kind:
    value: str


@pytest.mark.parametrize("times", [1, 2])
def test_the_frames_of_a_camera_that_drops_out_are_missing_once(tmp_path, times):
    rig = free(tmp_path)
    camera = next(iter(rig.cameras.values()))

    def on_next(number):
        if number >= 50 and camera.opened <= times:
            rig.clock.sleep(2.0)
            raise LinkLost("cameras.on_axis", "stream", "a frame", "none", "plug it in")

    camera.on_next = on_next
    outcome = rig.engine(reopen={name: lambda each=each: each for name, each in rig.cameras.items()}).run()
    assert (outcome.status, outcome.is_good) == ("completed", False)
    # 2 s, and the time to open the camera again
    assert outcome.timing.missing == pytest.approx(22 * times, abs=2 * times)
    assert outcome.timing.taken + outcome.timing.missing == pytest.approx(100, abs=1)


def test_the_first_frame_is_the_one_after_the_beginning_although_its_sample_comes_later(tmp_path):
    text = with_tables(
        'every_frame = true\nbegin = { channel = "channels.force", above = 1500 }', "images = 20"
    )
    rig = free(tmp_path, text)
    box = rig.channels["box"]
    box.signals = (replace(box.signals[0], delay_s=0.35),)
    assert rig.engine().run().is_good
    (middle_s, _) = middles(rig).values()
    with h5py.File(rig.path) as file:
        data = file["entry/channels/box"]
        beyond_s = data["time_s"][()][data["value_force"][()] > 1500.0][0] - 0.35
    assert len(middle_s) == 20
    assert beyond_s <= middle_s[0] <= beyond_s + 0.1


def paused_from_3_to_6_s(rig: FakeRig) -> Outcome:
    engine = rig.engine(reopen={name: lambda each=each: each for name, each in rig.cameras.items()})
    left: list[tuple[float, Callable[[], object]]] = [
        (3.0, lambda: engine.pause("a person")),
        (6.0, lambda: engine.go_on("a person")),
    ]

    def force_n(_):
        while left and rig.clock.now_s() >= left[0][0]:
            left.pop(0)[1]()
        return 0.0

    rig.channels["box"].force_n = force_n
    return engine.run()


def test_no_frame_of_a_pause_is_recorded(tmp_path):
    rig = free(tmp_path)
    outcome = paused_from_3_to_6_s(rig)
    assert outcome.is_good, outcome.shortfalls
    (middle_s, _) = middles(rig).values()
    assert np.diff(middle_s).max() == pytest.approx(3.1, abs=0.3)
    assert len(middle_s) == pytest.approx(70, abs=4)


def test_frames_of_a_pause_are_not_missing_if_a_camera_drops_out_after_it(tmp_path):
    rig = free(tmp_path)
    camera = next(iter(rig.cameras.values()))

    def on_next(number):
        if camera.opened == 2:
            rig.clock.sleep(1.0)
            raise LinkLost("cameras.on_axis", "stream", "a frame", "none", "plug it in")

    camera.on_next = on_next
    outcome = paused_from_3_to_6_s(rig)
    assert outcome.status == "completed", outcome.reason
    # 1 s, and the time to open the camera again
    assert outcome.timing.missing == pytest.approx(12, abs=2)


def test_a_camera_without_a_stream_cannot_lead(tmp_path):
    outcome = beside(tmp_path, EVERY).engine().run()
    assert outcome.status == "failed"
    assert "acquire.every_frame: expected a camera whose driver has a stream" in outcome.reason


def test_the_real_driver_of_a_triggered_camera(tmp_path):
    """The imitated producer films at 32 Hz, as if a trigger of this rate came."""
    rig = beside(tmp_path, with_tables("every_frame = true", "images = 50", BARE))
    device = FakeDevice(rig.clock)
    device.values |= dict.fromkeys(("TriggerSelector", "TriggerSource", "TriggerActivation"), "")
    device.values["TriggerMode"] = "Off"
    device.selected = {"TriggerSelector": ("FrameStart",)}
    context = OpenContext("cameras.on_axis", rig.clock)
    camera = opened(device, context, trigger="Line1", transfer_us=2000.0)
    rig.cameras = {"on_axis": camera}
    try:
        outcome = rig.engine().run()
    finally:
        camera.close()
    assert outcome.status == "completed", outcome.reason
    assert outcome.timing.missing == 0
    _, recorded, _ = steps(rig.path)
    assert len(recorded["middle_s"]) == 50
    np.testing.assert_allclose(np.diff(recorded["middle_s"]), 1 / 32, atol=2e-3)
