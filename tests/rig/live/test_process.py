"""Live gauges that another process measures: their values, and what happens when something fails."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from rig.live.beside import LiveProcess
from tests.rig.live.rendered_rig import RenderedRig, frame_of, to_and_fro
from tests.rig.live.test_frame_ring import named_memory

CLOCK = SystemClock()
PERIOD_S = 0.03
pytestmark = pytest.mark.realtime
RAW = ["area=area centre=200,200 size=60,60"]


def group_of(pid):
    """Return the numbers of all processes in the group that a process leads."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[2]) == pid and fields[0] != "Z":
                found.append(int(folder.name))
    return found


def wait_for(condition, within_s):
    """Wait until a condition is true; return whether it has become so."""
    end_s = CLOCK.now_s() + within_s
    while not (met := condition()) and CLOCK.now_s() < end_s:
        CLOCK.sleep(0.01)
    return met


class Watched:
    """Offers frames to a live measurement and collects its readings."""

    def __init__(self, rig, live):
        self.rig, self.live, self.sequence = rig, live, 0
        self._turn = to_and_fro(len(rig.pulled))

    def offer(self, *cameras, image=None):
        """Offer the next frame of some cameras, or of all, and return its place in the list of images."""
        self.sequence += 1
        place = next(self._turn) if image is None else image
        for name in cameras or self.rig.cameras:
            shown = self.rig.pulled[place][name]
            self.live.offer(name, frame_of(shown, self.sequence, CLOCK.now_s()))
        return place

    def measured(self, *cameras, count=1, image=None):
        """Offer frames one by one and return the readings in them, by the number of the frame."""
        found = []
        for _ in range(count):
            self.offer(*cameras, image=image)
            CLOCK.sleep(PERIOD_S)
            found += self.live.take()
        return found

    def last(self, **how):
        """Offer the next frames, and return the reading in them and their place in the list of images."""
        place, found = self.offer(**how), []

        def has_come():
            found.extend(self.live.take())
            return found and max(found[-1].frames.values()) == self.sequence

        assert wait_for(has_come, 5.0), self.live.failed
        return found[-1], place

    def until(self, condition, within_s=10.0):
        """Offer frames until a reading fulfils a condition, and return this reading."""
        end_s = CLOCK.now_s() + within_s
        while CLOCK.now_s() < end_s:
            for reading in self.measured():
                if condition(reading):
                    return reading
        raise AssertionError(f"no such reading; {self.live.failed}")


def is_valid(reading):
    return all(value.valid for value in reading.gauges.values())


@pytest.fixture(scope="module")
def pair():
    rig = RenderedRig()
    live = LiveProcess(rig.job, rig.infos)
    live.prepare(rig.grids, rig.references)
    yield Watched(rig, live)
    live.close()


@pytest.fixture
def raw():
    rig = RenderedRig("straight", gauges=RAW, motion="free")
    live = LiveProcess(rig.job, rig.infos, hang_s=0.6)
    live.prepare({}, rig.references)
    yield Watched(rig, live)
    live.close()


def test_two_cameras_give_corrected_strain_with_the_times_and_numbers_of_their_frames(pair):
    reading = pair.until(is_valid)
    assert {value.kind for value in reading.gauges.values()} == {"corrected"}
    assert set(reading.frames) == {"aside", "straight"}
    assert reading.missing == {}
    assert reading.time_s < reading.known_s < CLOCK.now_s()
    assert len({value.camera for value in reading.gauges.values()}) == 1
    for _ in range(8):
        last, place = pair.last()
    for value in last.gauges.values():
        assert abs(value.strain - 5e-4 * place) < 5 * value.std < 1e-3
    assert pair.live.failed == ""


def test_a_repeated_frame_is_not_valid(pair):
    pair.until(is_valid)
    first, _ = pair.last(image=2)
    for _ in range(10):
        again, _ = pair.last(image=2)
        if all(value.cause == "repeated" for value in again.gauges.values()):
            break
        # On a busy computer a frame of one camera may have been left out.
    assert all(value.cause == "repeated" for value in again.gauges.values())
    assert all(not value.valid and value.reason for value in again.gauges.values())
    assert again.time_s > first.time_s


def test_a_camera_that_is_missing_does_not_hold_up_the_other_one(pair):
    chosen = next(iter(pair.until(is_valid).gauges.values())).camera
    other = next(name for name in pair.rig.cameras if name != chosen)
    found = pair.measured(chosen, count=12)
    alone = [reading for reading in found if set(reading.frames) == {chosen}]
    assert len(alone) >= 9
    assert all("no frame" in reading.missing[other] for reading in alone)
    # A field of both cameras corrects it, as long as it is young enough.
    assert any(is_valid(reading) for reading in alone)
    assert all(value.kind == "corrected" for value in alone[-1].gauges.values())
    pair.until(is_valid)
    found = pair.measured(other, count=8)
    causes = {value.cause for reading in found for value in reading.gauges.values()}
    assert "no_frame" in causes
    (why, *_) = {v.reason for r in found for v in r.gauges.values() if v.cause == "no_frame"}
    assert why.startswith(f"no frame of {chosen}")
    assert set(pair.until(is_valid).frames) == {"aside", "straight"}


def test_of_frames_that_come_too_fast_the_newest_are_measured(pair):
    pair.until(is_valid)
    pair.live.take()
    before, longest_s = pair.live.left_out, 0.0
    for _ in range(60):
        begin_s = CLOCK.now_s()
        pair.offer()
        longest_s = max(longest_s, CLOCK.now_s() - begin_s)
    assert wait_for(lambda: pair.live.left_out > before, 2.0)
    CLOCK.sleep(0.3)
    readings = pair.live.take()
    assert 1 <= len(readings) < 60
    assert max(readings[-1].frames.values()) == pair.sequence
    assert np.all(np.diff([reading.time_s for reading in readings]) > 0.0)
    assert longest_s < 0.5


def test_the_process_that_solves_fields_may_be_killed(pair):
    pair.until(is_valid)
    (solver,) = [number for number in group_of(pair.live.pid) if number != pair.live.pid]
    os.kill(solver, signal.SIGKILL)
    assert wait_for(lambda: pair.measured() and len(set(group_of(pair.live.pid)) - {solver}) == 2, 5.0)
    later_s = CLOCK.now_s() + pair.rig.table.live().most_age_s
    pair.until(lambda reading: reading.time_s > later_s and is_valid(reading), 30.0)
    assert pair.live.failed == ""


def test_the_solver_of_fields_leaves_the_processors_to_the_run(pair):
    session = Path(f"/proc/{pair.live.pid}/autogroup")
    if not session.exists() or not os.sched_getscheduler(pair.live.pid) & os.SCHED_RR:
        pytest.skip("this system does not share its processors between sessions, or grants no real time")
    assert session.read_text().endswith("nice 19\n")
    # the run itself, beside which the solver works, is in another session
    assert Path("/proc/self/autogroup").read_text() != session.read_text()


def test_raw_strain_needs_no_grid_and_a_closed_measurement_leaves_no_process(raw):
    reading = raw.until(is_valid)
    assert reading.gauges["area"].kind == "raw"
    pid, begin_s = raw.live.pid, CLOCK.now_s()
    assert len(group_of(pid)) == 2
    raw.live.close()
    assert wait_for(lambda: not group_of(pid), 1.0)
    assert CLOCK.now_s() - begin_s < 1.0
    raw.live.close()
    raw.offer()
    assert raw.live.take() == []
    assert raw.live.failed == ""


def test_a_killed_process_is_told(raw):
    raw.until(is_valid)
    pid = raw.live.pid
    os.kill(pid, signal.SIGKILL)
    assert wait_for(lambda: raw.live.failed, 1.0)
    assert raw.live.failed == (
        "live gauges: its process was ended by signal 9; end the test, and start it anew"
    )
    assert wait_for(lambda: not group_of(pid), 1.0)
    raw.offer()


def test_a_process_that_hangs_is_told_and_killed(raw):
    raw.until(is_valid)
    pid = raw.live.pid
    os.kill(pid, signal.SIGSTOP)
    assert not wait_for(lambda: raw.live.failed, 0.3)
    assert wait_for(lambda: raw.live.failed, 1.5)
    assert "no sign of life for 0." in raw.live.failed
    assert wait_for(lambda: not group_of(pid), 1.0)


def test_images_that_cannot_be_used_are_refused_in_one_sentence():
    rig = RenderedRig("straight")
    live = LiveProcess(rig.job, rig.infos)
    with pytest.raises(DeviceError, match="live gauges: images of the grid: straight") as refused:
        live.prepare(rig.references, rig.references)
    assert refused.value.step == "find grid"
    live.close()


RUN = """
from tests.rig.live.rendered_rig import RenderedRig
from tests.rig.live.test_process import RAW, Watched
from rig.live.beside import LiveProcess
rig = RenderedRig("straight", gauges=RAW, motion="free")
live = LiveProcess(rig.job, rig.infos)
live.prepare({}, rig.references)
watched = Watched(rig, live)
watched.until(lambda reading: True)
print(live.pid, flush=True)
while True:
    watched.measured()
"""


def test_a_killed_run_leaves_no_process_and_no_memory_and_prints_nothing():
    env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    run = subprocess.Popen(
        [sys.executable, "-c", RUN], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env
    )
    pid = int(run.stdout.readline())
    assert len(group_of(pid)) == 2
    for each in (run.pid, *group_of(pid)):
        assert named_memory(each) == set()
    run.kill()
    assert wait_for(lambda: not group_of(pid), 1.0)
    # The pipe is at its end, because no process is left that holds it open.
    assert run.communicate(timeout=5.0) == ("", "")
