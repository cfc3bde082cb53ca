"""After kill -9 of a pull at a random moment, all acknowledged frames are on file and the machine stands.

Machine and cameras are those of `rig simulate`, a program of their own that goes on and knows the truth.
"""

import json
import random
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from statistics import median

import pytest

from dic.runfile.reader import RunFile
from rig.commands.repair import repair_run
from rig.live.signals import RECORDED
from tests.continuous.pulls import AT_RATE, LIVE, SEES, protocol_text, rig_text
from tests.continuous.told_pull import told_path
from tests.rig.guardian.stopping import Bench, Machine, wait_for_end

PERIOD_S = 0.01
PULLS_S = 6.0
"""A run is killed within this time of its motion, while the specimen is elastic."""
STANDS_MS = 1000.0
"""The guardian stops it within 50 ms in the median (`test_stop_times`); a busy computer may take longer."""
CAMERAS = ("front", "beside")
# A busy computer may hold the machine meanwhile; frames come and are recorded all the time.
PHASES = AT_RATE.replace("every_s = 0.5", "every_frame = true") + "return_s = 30.0\n"
IMAGES = "[images]\nstill = 0\ntimeout_s = 30.0\n"
PULL = Machine("load_frame", protocol_text(PHASES, LIVE + IMAGES), "displacement 18", "displacement_mm")


@pytest.fixture
def bench(tmp_path) -> Iterator[Bench]:
    specimen = {"machine_stiffness_n_mm": 60_000.0, "grip_slip_mm": 0.0}
    text = rig_text(dict.fromkeys(CAMERAS, SEES), specimen, prepared={"margin_px": 64})
    text = text.replace('"simulated-operator"', '"simulated-operator"\nduration_s = 0.1')
    with closing(Bench(tmp_path, text, (PULL,), PERIOD_S)) as started:
        started.program = [sys.executable, "-m", "tests.continuous.told_pull"]
        yield started


def started_by(parent: int) -> list[int]:
    """Return the processes that a process has started, and those that these have started."""
    children = defaultdict(list)
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            before = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except OSError:
            continue
        children[int(before)].append(int(folder.name))
    found = [parent]
    for pid in found:
        found += children[pid]
    return found[1:]


def frames_in_log(bench: Bench) -> set[tuple[str, float]]:
    """Return camera and true middle of the exposure of all frames that the simulation has taken."""
    *lines, _ = (bench.folder / "log").read_text().split("\n")
    frames = (json.loads(line) for line in lines if '"what": "frame"' in line)
    return {(frame["camera"], round(frame["middle_s"], 6)) for frame in frames}


def check_file(path: Path, exposed: set[tuple[str, float]]) -> int:
    """Repair the file of a killed pull and compare it. Return the number of frames of a camera."""
    told = [line.split() for line in told_path(path).read_text().splitlines()]
    repair_run(path)
    with RunFile(path) as run:
        assert not any(run.damaged_rows(camera) for camera in run.cameras)
        steps = {step.index: step for step in run.steps}
        middles = {camera: run.columns(f"instrument/{camera}")["middle_s"] for camera in CAMERAS}
        for index, kind, time_s, *images in told:
            step = steps[int(index)]
            assert (step.kind, step.time_s) == (kind, float(time_s))
            for camera, first, count in (each.split(":") for each in images):
                rows = run.rows(camera, step)
                assert rows == range(int(first), int(first) + int(count))
                for row in rows:
                    assert (camera, round(float(middles[camera][row]), 6)) in exposed
                    assert run.frame(camera, row).shape == (SEES["height_px"], SEES["width_px"])
            assert len(images) == len(CAMERAS)
        # a motion begins only when the live gauges have values
        assert len(run.columns(f"channels/{RECORDED}")["time_s"])
    return sum(kind == "acquired" for _, kind, *_ in told)


def check_kills(bench: Bench, count: int, seed: int) -> None:
    rng = random.Random(seed)
    frames, stood_ms = [], []
    for _ in range(count):
        with closing(bench.started(PULL)) as run:
            time.sleep(rng.uniform(0.0, PULLS_S))
            assert run.process.poll() is None, run.end()[1]
            others = started_by(run.process.pid)
            # the guardian, the live gauges and what solves their fields
            assert len(others) >= 3
            killed_s = time.monotonic()
            run.process.kill()
            stood_ms.append(1e3 * (bench.wait_for_standstill(PULL, killed_s) - killed_s))
            for pid in (run.process.pid, *others):
                wait_for_end(pid)
        frames.append(check_file(bench.folder / "run.h5", frames_in_log(bench)))
        print(
            f"{frames[-1]} acknowledged frames of each camera; the machine stood after {stood_ms[-1]:.0f} ms"
        )
    print(f"in the median after {median(stood_ms):.0f} ms, at most {max(stood_ms):.0f} ms, of {count}")
    assert max(stood_ms) <= STANDS_MS
    assert sum(frames) > 5 * count


@pytest.mark.extended
def test_what_a_killed_pull_has_told_is_on_file(bench):
    check_kills(bench, 1, seed=0)


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", range(1, 5))
def test_what_five_killed_pulls_have_told_is_on_file(bench, seed):
    check_kills(bench, 5, seed)
