"""The last images of a long run stay in a file of constant size, which is readable at every moment."""

import os
import random
import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.repair import repair_run
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord, tables
from tests.rig.recorder.endless_ring_run import BLOCK, FIRST, KEPT
from tests.rig.recorder.forked_runs import ForkedRuns
from tests.run_files import CAMERAS, HEADER, START, take


def require_whole(path: Path, acknowledged: int, *, in_flight: int = 0) -> None:
    """Check that all steps in the file have their own images, and that the newest ones are all there."""
    with RunFile(path) as run:
        assert len(run.steps) + run.overwritten >= acknowledged
        indices = [step.index for step in run.steps]
        assert indices == sorted(indices)
        newest = range(max(FIRST, acknowledged - KEPT + in_flight), acknowledged)
        assert set(newest) | set(range(min(FIRST, acknowledged))) <= set(indices)
        for step in run.steps:
            for name, info in CAMERAS.items():
                image = run.image(name, step, stored=True)
                np.testing.assert_array_equal(image, take(info, step.index).image)
        assert not any(run.damaged_rows(name) for name in run.cameras)
        for name in run.cameras:
            assert len(run.rows_on_file(name)) <= FIRST + KEPT


@pytest.fixture(scope="module")
def runs() -> Iterator[ForkedRuns]:
    with closing(ForkedRuns("tests.rig.recorder.endless_ring_run")) as started:
        yield started


def check_random_kills(runs: ForkedRuns, folder: Path, count: int, seed: int) -> None:
    rng = random.Random(seed)
    for number in range(count):
        path = folder / f"run-{number}.h5"
        # before, at and after the first time that an image is overwritten
        steps = rng.choice([KEPT, KEPT + FIRST, rng.randrange(10, 60)])
        acknowledged = runs.killed(path, steps, rng.uniform(0.0, 0.05))
        repair_run(path)
        # The image of the step that was being written has taken the place of an older one.
        require_whole(path, acknowledged, in_flight=1)
        with RunFile(path) as run:
            box = run.columns("channels/box")
            assert len(box["number"]) >= BLOCK * acknowledged
            assert (np.diff(box["number"]) == 1).all()
            np.testing.assert_array_equal(box["value_force"], box["number"])
        path.unlink()


@pytest.mark.timeout(400)
def test_a_killed_ring_has_its_newest_images_and_all_samples(runs, tmp_path):
    check_random_kills(runs, tmp_path, 6, seed=1)


@pytest.mark.extended
@pytest.mark.timeout(400)
def test_no_acknowledged_image_is_lost_from_a_ring_in_twenty_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 20, seed=2)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_no_acknowledged_image_is_lost_from_a_ring_in_two_hundred_kills(runs, tmp_path):
    check_random_kills(runs, tmp_path, 200, seed=3)


def record(path: Path, count: int, *, wait: bool) -> None:
    recorder = Recorder(path, HEADER, CAMERAS)
    for index in range(count):
        keep_s = None if index < FIRST else KEPT - 0.5
        while not all(recorder.wait_for_room(name, 10.0) for name in CAMERAS):
            pass
        frames = {
            name: (recorder.frame(name, take(info, index), keep_s), 1) for name, info in CAMERAS.items()
        }
        kind = ("grid", "reference", "acquired")[min(index, 2)]
        written = recorder.step(StepRecord(ProtocolStep(index, kind), RigReading(float(index)), frames))
        if wait:
            written.result(60)
    recorder.close("completed", "", START)


@pytest.mark.parametrize("wait", [True, False])
@pytest.mark.parametrize("count", [5, FIRST + KEPT, FIRST + KEPT + 1, 100])
def test_the_newest_images_stay_and_the_digests_are_right(tmp_path, count, wait):
    """Without a wait for the disk, several images of one row are in the queue, and in one batch."""
    record(tmp_path / "run.h5", count, wait=wait)
    require_whole(tmp_path / "run.h5", count)
    with RunFile(tmp_path / "run.h5") as run:
        assert run.overwritten == max(0, count - FIRST - KEPT)
        assert run.digest_matches() is True


def test_the_file_is_readable_after_each_of_its_writes(tmp_path, monkeypatch):
    """Copies of the file after each write of an overwritten image are what a kill there leaves."""
    path, copies = tmp_path / "run.h5", []
    count = FIRST + KEPT + 1

    def copied_after(function):
        def call(*arguments):
            function(*arguments)
            copies.append(path.with_name(f"copy-{len(copies)}.h5"))
            shutil.copy(path, copies[-1])

        return call

    def half(descriptor, image, offset):
        os.pwrite(descriptor, image.tobytes()[: image.nbytes // 2], offset)
        copies.append(path.with_name(f"copy-{len(copies)}.h5"))
        shutil.copy(path, copies[-1])
        os.pwrite(descriptor, image.tobytes(), offset)

    monkeypatch.setattr(tables._Column, "put_again", copied_after(tables._Column.put_again))
    monkeypatch.setattr(tables, "_write_all", half)
    record(path, count, wait=True)
    overwritten = len(CAMERAS)
    assert len(copies) > 12 * overwritten
    for copy in copies:
        repair_run(copy)
        with RunFile(copy) as run:
            # the image is overwritten after the image before it was acknowledged
            acknowledged = len(run.steps) + run.overwritten
        require_whole(copy, acknowledged, in_flight=1)


def test_the_file_grows_by_rows_of_tables_only(tmp_path):
    record(tmp_path / "short.h5", 40, wait=False)
    record(tmp_path / "long.h5", 400, wait=False)
    image = CAMERAS["left"].width_px * CAMERAS["left"].height_px
    grown = (tmp_path / "long.h5").stat().st_size - (tmp_path / "short.h5").stat().st_size
    assert grown < 2 * 360 * image / 4
