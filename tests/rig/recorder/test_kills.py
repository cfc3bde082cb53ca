"""After kill -9 at a random moment, every file opens after a repair, and has all acknowledged images."""

import random
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.repair import repair_run
from rig.commands.verify import verify_run
from tests.rig.recorder.endless_run import FRAMES, number_of
from tests.rig.recorder.forked_runs import ForkedRuns
from tests.run_files import CAMERAS, take


@pytest.fixture(scope="module")
def runs() -> Iterator[ForkedRuns]:
    with closing(ForkedRuns("tests.rig.recorder.endless_run")) as started:
        yield started


def check_killed_run(path: Path, acknowledged: int) -> None:
    """Repair the file of a killed run, and compare it with the acknowledged steps."""
    repair_run(path)
    steps = contents(path, acknowledged)
    cut_off, *others = verify_run(path).problems
    assert cut_off.startswith("the run is running, or was cut off")
    assert len(others) == max(0, 2 - steps)  # no grid, no reference


def contents(path: Path, acknowledged: int) -> int:
    """Compare every image in the file with the recorded image; return the number of steps in the file."""
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


def check_random_kills(runs: ForkedRuns, folder: Path, count: int, seed: int) -> None:
    rng = random.Random(seed)
    for number in range(count):
        path = folder / f"run-{number}.h5"
        # Also in the very beginning, and where a table gets its second and third chunk of 256 rows.
        steps = rng.choice([0, 1, 3, rng.randrange(20), rng.randrange(40, 90)])
        acknowledged = runs.killed(path, steps, rng.uniform(0.0, 0.05))
        if path.exists():
            check_killed_run(path, acknowledged)
        else:
            assert acknowledged == 0
        path.unlink(missing_ok=True)


@pytest.mark.timeout(400)
def test_no_acknowledged_image_is_lost_in_six_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 6, seed=3)


@pytest.mark.extended
@pytest.mark.timeout(400)
def test_no_acknowledged_image_is_lost_in_twenty_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 20, seed=1)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_no_acknowledged_image_is_lost_in_two_hundred_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 200, seed=2)
