"""Every command that takes a run file refuses a damaged or hostile one with one sentence and status 2."""

import os
import random
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.errors import MeasurementError, RunFileError
from dic.pipeline.run import process_run
from rig.commands.verify import verify_run
from tests.command_line import refusal, run_dic, run_rig
from tests.run_files import HOSTILE, changed, write_run


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "run.h5")


def test_the_run_that_is_changed_here_is_good(good):
    found = verify_run(good)
    assert (found.problems, found.digest) == ([], "right")
    done = run_rig("repair", good)
    assert (done.status, done.out) == (0, "nothing to repair\n")


@pytest.mark.parametrize("harm", HOSTILE)
def test_hostile_run_is_one_sentence(good, tmp_path, harm):
    run = changed(good, HOSTILE[harm], tmp_path / "run.h5")
    before = run.read_bytes()
    for arguments in (["verify", run], ["repair", run]):
        done = run_rig(*arguments)
        assert (done.status, done.out) == (2, ""), done
        assert done.err.count("\n") == 1
        assert done.err.startswith(f"rig: {run}: ")
    assert str(run) in refusal("process", run)
    assert run.read_bytes() == before


def test_file_of_eight_tebibytes_that_holds_nothing_is_one_sentence(good, tmp_path):
    run = tmp_path / "run.h5"
    run.write_bytes(good.read_bytes())
    with run.open("r+b") as file:
        file.truncate(1 << 43)
    done = run_rig("verify", run)
    assert done.status == 1
    assert "digest of the file is wrong" in done.out


def flip(content: bytes, place: int, bits: int) -> bytes:
    return content[:place] + bytes([content[place] ^ bits]) + content[place + 1 :]


def check_a_flipped_byte_is_told(good: Path, path: Path, rng: random.Random) -> None:
    content = good.read_bytes()
    place = rng.randrange(len(content))
    path.unlink(missing_ok=True)
    path.write_bytes(flip(content, place, rng.randrange(1, 256)))
    try:
        problems = verify_run(path).problems
    except RunFileError as error:
        problems = [str(error)]
    assert problems, place
    assert "\n" not in "".join(problems)
    done = run_rig("repair", path)
    assert (done.status, done.err.count("\n")) in ((0, 0), (2, 1))


def test_every_flipped_byte_is_told(good, tmp_path):
    rng = random.Random(1)
    for _ in range(10):
        check_a_flipped_byte_is_told(good, tmp_path / "run.h5", rng)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_thousand_flipped_bytes_are_told(good, tmp_path):
    rng = random.Random(2)
    for _ in range(1000):
        check_a_flipped_byte_is_told(good, tmp_path / "run.h5", rng)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("status", lambda text: b"aborted"),
        ("title", lambda text: text.replace(b"R", b"S")),
        ("steps/load_n", lambda values: values + 1.0),
        ("grid/pitch_mm", lambda value: 2.0 * value),
        ("instrument/left/digest", lambda texts: texts[::-1]),
    ],
)
def test_changed_value_is_told(good, tmp_path, name, change):
    run = tmp_path / "run.h5"
    run.write_bytes(good.read_bytes())
    with h5py.File(run, "r+") as file:
        data = file[f"entry/{name}"]
        data[...] = change(data[()])
    found = verify_run(run)
    assert found.digest == "wrong"
    assert found.problems


@pytest.mark.parametrize(
    ("column", "row", "value", "problem"),
    [
        ("index", 3, 2, "step 2 follows step 2"),
        ("load_n", 2, np.nan, "step 2 of kind load has no load_n"),
        ("count_left", 4, 0, "step 4 has no image of left"),
        ("frames_left", 4, 3, "left: some images belong to two steps"),
        ("kind", 0, b"load", "step of kind grid: 1 expected, 0 on file"),
        ("kind", slice(0, 2), [b"reference", b"grid"], "the steps are out of order"),
    ],
)
def test_what_dic_process_needs_is_checked(good, tmp_path, column, row, value, problem):
    run = tmp_path / "run.h5"
    run.write_bytes(good.read_bytes())
    with h5py.File(run, "r+") as file:
        file[f"entry/steps/{column}"][row] = value
    assert problem in verify_run(run).problems


def test_image_that_was_changed_is_not_measured(good, tmp_path):
    run = tmp_path / "run.h5"
    run.write_bytes(good.read_bytes())
    with h5py.File(run, "r+") as file:
        file["entry/instrument/left/data"][0, 3, 4] ^= 1
    assert "damaged images of left at step 0" in refusal("process", run)


@pytest.mark.parametrize("cut", [0, 100, 4096, 4144, 6000, 0.3, 0.5, 0.9, 0.999])
def test_cut_off_run_is_one_sentence_or_says_what_is_missing(good, tmp_path, cut):
    run = tmp_path / "run.h5"
    content = good.read_bytes()
    run.write_bytes(content[: int(cut * len(content)) if isinstance(cut, float) else cut])
    assert run_rig("verify", run).status == 2
    done = run_rig("repair", run)
    assert done.status in (0, 2)
    assert done.err.count("\n") == done.status // 2
    if done.status == 0:
        assert verify_run(run).problems


@pytest.mark.parametrize("made", ["folder", "pipe", "nothing", "empty", "text"])
def test_what_is_no_file_of_ours_is_one_sentence(tmp_path, made):
    path = tmp_path / "run.h5"
    {
        "folder": path.mkdir,
        "pipe": lambda: os.mkfifo(path),
        "nothing": lambda: None,
        "empty": path.touch,
        "text": lambda: path.write_text("no HDF5"),
    }[made]()
    for done in (
        run_rig("verify", path),
        run_rig("repair", path),
        run_dic("process", path),
        run_dic("report", path),
    ):
        assert (done.status, done.out) == (2, "")
        assert done.err.count("\n") == 1


def test_dic_process_of_a_changed_run_ends_with_an_error_of_its_own(good, tmp_path):
    """The images show no grid, so that even the good run cannot be measured: in one sentence."""
    with pytest.raises(MeasurementError, match="grid"):
        process_run(good)
