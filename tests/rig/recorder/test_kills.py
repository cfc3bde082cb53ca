"""kill -9 at random moments: every file opens after at most a repair, and no acknowledged image is lost."""

import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from queue import Queue

import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.repair import repair_run
from rig.commands.verify import verify_run
from tests.places import ROOT
from tests.rig.recorder.endless_run import FRAMES, number_of
from tests.run_files import CAMERAS, take


class Runs:
    """A program that records runs, one after the other."""

    def __init__(self) -> None:
        self._program = subprocess.Popen(
            [sys.executable, "-m", "tests.rig.recorder.endless_run"],
            cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
        )  # fmt: skip
        self._lines: Queue[str] = Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._program.stdout is not None
        with self._program.stdout as lines:
            for line in lines:
                self._lines.put(line.strip())

    def killed(self, path: Path, steps: int, then_s: float) -> int:
        """Start a run, kill it `then_s` after so many steps; return the number of acknowledged steps."""
        assert self._program.stdin is not None
        self._program.stdin.write(f"{path}\n")
        child, acknowledged = 0, 0
        while acknowledged < steps or not child:
            word, _, number = self._lines.get(timeout=60).partition(" ")
            child = int(number) if word == "child" else child
            acknowledged += word == "step"
        threading.Event().wait(then_s)
        os.kill(child, signal.SIGKILL)
        while (line := self._lines.get(timeout=60)) != "ended":
            acknowledged += line.startswith("step")
        return acknowledged

    def close(self) -> None:
        assert self._program.stdin is not None
        self._program.stdin.close()
        self._program.wait(60)
        self._reader.join(60)


@pytest.fixture(scope="module")
def runs() -> Iterator[Runs]:
    runs = Runs()
    yield runs
    runs.close()


def check_killed_run(path: Path, acknowledged: int) -> None:
    """Repair a file, and compare it with what was acknowledged."""
    repair_run(path)
    steps = contents(path, acknowledged)
    cut_off, *others = verify_run(path).problems
    assert cut_off.startswith("the run is running, or was cut off")
    assert len(others) == max(0, 2 - steps)  # no grid, no reference


def contents(path: Path, acknowledged: int) -> int:
    """Compare every acknowledged image with what was recorded; return the number of steps on file."""
    with RunFile(path) as run:
        assert len(run.steps) >= acknowledged
        for step in run.steps:
            for camera, (name, info) in enumerate(CAMERAS.items()):
                numbers = [number_of(step.index, camera, k) for k in range(FRAMES)]
                expected = np.mean([take(info, number).image for number in numbers], axis=0)
                np.testing.assert_array_equal(run.image(name, step), expected.astype(np.float32))
            assert (step.time_s, step.load_n) == (step.index, 1000.0 * step.index)
        assert not any(run.damaged_rows(name) for name in run.cameras)
        return len(run.steps)


def check_random_kills(runs: Runs, folder: Path, count: int, seed: int) -> None:
    rng = random.Random(seed)
    for number in range(count):
        path = folder / f"run-{number}.h5"
        # Also in the very beginning, and where a table gets its second and third chunk of 256 rows.
        steps = rng.choice([0, 1, 3, rng.randrange(20), rng.randrange(40, 90)])
        acknowledged = runs.killed(path, steps, rng.uniform(0.0, 0.05))
        if path.exists() and (acknowledged or path.stat().st_size > 20_000):
            check_killed_run(path, acknowledged)
        else:
            assert acknowledged == 0
        path.unlink(missing_ok=True)


@pytest.mark.timeout(400)
def test_no_acknowledged_image_is_lost_in_twenty_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 20, seed=1)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_no_acknowledged_image_is_lost_in_two_hundred_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 200, seed=2)
