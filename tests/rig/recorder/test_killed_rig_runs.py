"""After kill -9 of `rig run` at a random moment, the file opens after `rig repair` with all reported data.

A run reports a finished step by a line on standard output and by a line in its file of events. The virtual
rig gives the same images in every run. So a changed image differs from the same image of another run.
"""

import json
import random
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from dic.runfile.digests import frame_digest
from dic.runfile.reader import RunFile
from rig.commands.verify import verify_run
from rig.news.files import events_path
from tests.command_line import run_rig
from tests.rig.recorder.endless_rig_run import write_files
from tests.rig.recorder.forked_runs import ForkedRuns

OPENING_S = 0.4
"""Approximate time in s from the beginning of a run to its first step."""
STEP_S = 0.06
"""Time in s that is slightly longer than the duration of a step."""

Digests = dict[tuple[str, int], str]
"""The digest of each image in the runs' files, by camera and row."""


@pytest.fixture(scope="module")
def runs() -> Iterator[ForkedRuns]:
    with closing(ForkedRuns("tests.rig.recorder.endless_rig_run")) as started:
        yield started


def events_of(path: Path) -> list[dict[str, Any]]:
    """Return the complete events of a killed run. An incomplete last line is ignored."""
    if not events_path(path).exists():
        return []
    *lines, _ = events_path(path).read_text().split("\n")
    return [json.loads(line) for line in lines]


def check_killed_run(path: Path, printed: int, digests: Digests) -> int:
    """Repair the file of a killed run, compare it with the reported steps, and return its number of steps."""
    events = events_of(path)
    told = [event for event in events if event["event"] == "step"]
    begun = any(event["event"] == "state" for event in events)
    if not begun:
        assert (printed, told) == (0, [])
        return 0
    repaired = run_rig("repair", path)
    assert (repaired.status, repaired.err) == (0, "")
    with RunFile(path) as run:
        assert len(run.steps) >= max(printed, len(told))
        assert [step.index for step in run.steps] == list(range(len(run.steps)))
        assert not any(run.damaged_rows(camera) for camera in run.cameras)
        for step, event in zip(run.steps, told, strict=False):
            assert (step.index, step.kind) == (event["step"]["index"], event["step"]["kind"])
            assert (step.time_s, step.angle_deg) == tuple(
                event["reading"][k] for k in ("time_s", "angle_deg")
            )
            assert set(run.cameras) == set(event["images"])
            for camera, images in event["images"].items():
                rows = range(images["first_row"], images["first_row"] + images["count"])
                assert (len(rows), run.rows(camera, step)) == (2, rows)
                for row in rows:
                    digest = frame_digest(run.frame(camera, row))
                    assert digests.setdefault((camera, row), digest) == digest
        steps = len(run.steps)
    cut_off, *others = verify_run(path).problems
    assert cut_off.startswith("the run is running, or was cut off")
    assert len(others) == max(0, 2 - steps)  # no grid, no reference
    return steps


def check_random_kills(runs: ForkedRuns, folder: Path, moments: list[tuple[int, float]]) -> None:
    """Kill one run for each moment (number of steps, further time in s), and check each run file."""
    write_files(folder)
    digests: Digests = {}
    for number, (steps, then_s) in enumerate(moments):
        path = folder / f"run-{number}.h5"
        printed = runs.killed(path, steps, then_s)
        assert check_killed_run(path, printed, digests) >= printed >= steps
        path.unlink(missing_ok=True)
    assert len(digests) >= 4 * max(steps for steps, _ in moments)


def random_moments(count: int, seed: int, steps_max: int) -> list[tuple[int, float]]:
    rng = random.Random(seed)
    chosen = (
        rng.choice([0, 1, 2, rng.randrange(3, steps_max), rng.randrange(3, steps_max)]) for _ in range(count)
    )
    return [(steps, rng.uniform(0.0, STEP_S if steps else OPENING_S)) for steps in chosen]


@pytest.mark.extended
def test_what_a_killed_rig_run_has_told_is_on_file(runs, tmp_path):
    # in the beginning, after a step, and amid one
    check_random_kills(runs, tmp_path, [(0, OPENING_S / 2), (4, 0.0), (4, STEP_S / 2)])


@pytest.mark.extended
def test_what_some_killed_rig_runs_have_told_is_on_file(runs, tmp_path):
    check_random_kills(runs, tmp_path, [(0, OPENING_S / 2), *random_moments(3, 1, 8), (6, STEP_S / 2)])


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_what_eighty_killed_rig_runs_have_told_is_on_file(runs, tmp_path):
    # 256 readings of the stage, after which a table gets its next chunk, are there after about 60 steps
    check_random_kills(runs, tmp_path, random_moments(80, 2, 80))
