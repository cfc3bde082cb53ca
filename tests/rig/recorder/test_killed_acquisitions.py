"""After kill -9 of an acquisition at a random moment, each acknowledged frame and sample is on file."""

import random
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.repair import repair_run
from tests.rig.recorder.endless_acquisition import KEEP_S, PERIOD_S, number_in, told_path
from tests.rig.recorder.forked_runs import ForkedRuns

MOST_STEPS = 120


@pytest.fixture(scope="module")
def runs() -> Iterator[ForkedRuns]:
    with closing(ForkedRuns("tests.rig.recorder.endless_acquisition")) as started:
        yield started


def told(path: Path) -> list[tuple[int, float, int]]:
    """Return step, middle of the exposure and last sample before it of each acknowledged step."""
    lines = told_path(path).read_text().splitlines() if told_path(path).exists() else []
    return [(int(step), float(middle_s), int(last)) for step, middle_s, last in map(str.split, lines)]


def check_killed_acquisition(path: Path, printed: int, *, ring: bool) -> int:
    """Repair the file of a killed acquisition and compare it. Return the number of acknowledged steps."""
    acknowledged = told(path)
    assert len(acknowledged) >= printed
    if not path.exists():
        assert not acknowledged
        return 0
    repair_run(path)
    with RunFile(path) as run:
        box = run.columns("channels/box")
        numbers = box["number"]
        np.testing.assert_array_equal(numbers, np.arange(len(numbers)))
        np.testing.assert_array_equal(box["value_number"], numbers)
        np.testing.assert_array_equal(box["value_twice"], 2.0 * numbers)
        steps = {step.index: step for step in run.steps}
        if acknowledged:
            assert len(numbers) > acknowledged[-1][2]
        # the image of the step that was being written may have taken the place of an older one
        oldest_s = acknowledged[-1][1] - KEEP_S + 3 * PERIOD_S if ring and acknowledged else -np.inf
        for index, middle_s, _ in acknowledged:
            # the first image is the reference, which stays in a ring too
            if middle_s >= oldest_s or index == 0:
                assert steps[index].time_s == pytest.approx(middle_s, abs=1e-6)
        for step in run.steps:
            shown = {number_in(run.image(camera, step, stored=True)) for camera in run.cameras}
            # both cameras expose at the same times, and number frames by them
            assert len(shown) == 1
            assert shown.pop() * PERIOD_S + 0.001 == pytest.approx(step.time_s, abs=1e-6)
        assert not any(run.damaged_rows(camera) for camera in run.cameras)
        if ring:
            most = KEEP_S / PERIOD_S + 3
            assert all(len(run.rows_on_file(camera)) <= most for camera in run.cameras)
    return len(acknowledged)


def check_random_kills(runs: ForkedRuns, folder: Path, count: int, seed: int, *, ring: bool) -> None:
    rng = random.Random(seed)
    found = asked = 0
    for number in range(count):
        path = folder / f"{'ring' if ring else 'run'}-{number}.h5"
        # in the very beginning, before, at and after the first time that an image is overwritten
        steps = rng.choice([0, 1, rng.randrange(40, 60), rng.randrange(2, MOST_STEPS)])
        printed = runs.killed(path, steps, rng.uniform(0.0, 0.1 if steps else 1.0))
        asked += steps
        found += check_killed_acquisition(path, printed, ring=ring)
        path.unlink(missing_ok=True)
    assert found >= asked > 10 * count


@pytest.mark.extended
@pytest.mark.parametrize("ring", [False, True], ids=["all", "ring"])
def test_what_some_killed_acquisitions_have_told_is_on_file(runs, tmp_path, ring):
    check_random_kills(runs, tmp_path, 3, seed=0, ring=ring)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("ring", [False, True], ids=["all", "ring"])
def test_what_twenty_killed_acquisitions_have_told_is_on_file(runs, tmp_path, ring):
    check_random_kills(runs, tmp_path, 20, seed=4, ring=ring)
