"""Which frames of two cameras are measured together, by their times and by when they arrive."""

import numpy as np
import pytest

from rig.live.pairing import Arrival, Pairing, middle_of


def run(arrivals, cameras=("a", "b"), until_s=1.0):
    """Let frames (camera, exposed, arrived) come, look every ms, and return what is measured, and when."""
    pairing, found, numbers = Pairing(cameras, 0.0), [], dict.fromkeys(cameras, 0)
    waiting = sorted(arrivals, key=lambda each: each[2])
    for ms in range(round(1000 * until_s)):
        now_s = 1e-3 * ms
        while waiting and waiting[0][2] <= now_s:
            camera, exposed_s, _ = waiting.pop(0)
            numbers[camera] += 1
            pairing.arrived(camera, Arrival(numbers[camera], exposed_s), now_s)
        while (together := pairing.next(now_s)) is not None:
            found.append((now_s, together))
    return found


def stream(camera, period_s, first_s=0.0, late_s=0.005, until_s=1.0):
    count = int((until_s - first_s) / period_s)
    return [(camera, first_s + k * period_s, first_s + k * period_s + late_s) for k in range(count)]


@pytest.mark.parametrize(("shift_s", "late_s"), [(0.0, 0.005), (0.004, 0.005), (0.013, 0.005), (0.0, 0.047)])
def test_frames_of_two_cameras_are_paired_if_they_are_nearest(shift_s, late_s):
    """Also if one camera is out of step with the other, or its frames arrive two intervals late."""
    found = run([*stream("a", 0.02), *stream("b", 0.02, shift_s, late_s)])
    steady = [each for each in found if each[0] > 0.2]
    assert len(steady) >= 38
    for now_s, together in steady:
        times = {name: arrival.time_s for name, arrival in together.frames.items()}
        assert set(times) == {"a", "b"}
        assert abs(times["a"] - times["b"]) <= 0.01 + 1e-9
        assert not together.missing
        # It was measured as soon as both were there.
        assert now_s - min(times.values()) < max(0.006, late_s + 0.002) + 0.02


def test_a_camera_that_ends_does_not_hold_up_the_other_one():
    found = run([*stream("a", 0.02), *stream("b", 0.02, until_s=0.5)])
    alone = [(now_s, each) for now_s, each in found if set(each.frames) == {"a"}]
    assert len(alone) >= 22
    assert all("no frame for" in each.missing["b"] for _, each in alone)
    # The first one waits for one and a half intervals of the other camera, the others do not wait.
    assert all(now_s - each.frames["a"].time_s < 0.035 for now_s, each in alone[:1])
    assert all(now_s - each.frames["a"].time_s < 0.007 for now_s, each in alone[2:])


def test_a_camera_that_never_comes_is_awaited_for_a_second_only():
    found = run(stream("a", 0.02, until_s=2.0), until_s=2.0)
    assert found[0][0] == pytest.approx(1.0, abs=0.02)
    assert len(found) >= 45


def test_a_lost_frame_lets_the_other_one_be_measured_alone():
    beside = [each for each in stream("b", 0.05) if abs(each[1] - 0.5) > 0.01]
    found = run([*stream("a", 0.05), *beside])
    alone = [each for _, each in found if len(each.frames) == 1]
    assert len([each for each in alone if 0.2 < each.frames["a"].time_s < 0.9]) <= 1
    assert len([each for _, each in found if len(each.frames) == 2]) >= 17


def test_the_slower_camera_sets_the_pace():
    found = [each for now_s, each in run([*stream("a", 0.1), *stream("b", 0.03)]) if now_s > 0.3]
    assert {tuple(sorted(each.frames)) for each in found} == {("a", "b")}
    assert len(found) in (6, 7)


def test_cameras_whose_clocks_do_not_agree_are_measured_alone():
    shifted = [(name, time_s + 3.0 * (name == "b"), at_s) for name, time_s, at_s in stream("b", 0.02)]
    alone = [each for _, each in run([*stream("a", 0.02), *shifted])]
    assert alone
    assert {"its frames were exposed at other times"} == {
        why for each in alone for why in each.missing.values()
    }


def test_only_the_newest_frames_of_a_burst_are_measured():
    burst = [("a", 0.01 * k, 0.2) for k in range(10)]
    ((_, together),) = run(burst, cameras=("a",))
    assert together.frames["a"].number == 10


def test_the_times_of_what_is_measured_increase():
    """Also if frames come faster than they are looked at, and in pairs whose distance changes."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        burst, at_s = [], 0.4
        for wait_s, apart_s in zip(rng.choice([2e-4, 3e-3], 60), rng.choice([5e-5, 2e-3], 60), strict=True):
            at_s += wait_s + apart_s
            burst += [("a", at_s - apart_s, at_s - apart_s), ("b", at_s, at_s)]
        found = run([*stream("a", 0.03, until_s=0.4), *stream("b", 0.03, 1e-4, until_s=0.4), *burst])
        times = [middle_of(together.frames.values())[0] for _, together in found]
        assert len(times) > 30
        assert np.all(np.diff(times) > 0.0)


def test_a_camera_whose_clock_was_set_back_is_measured():
    again = [(camera, at_s - 3.0, come_s) for camera, at_s, come_s in stream("a", 0.02, 0.5)]
    found = run([*stream("a", 0.02, until_s=0.5), *again], cameras=("a",))
    assert len(found) == 50
