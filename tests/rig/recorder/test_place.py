"""A run file that is deleted or moved ends the run, says where its data are, and loses none of them."""

import os
import re
import shutil
from pathlib import Path

import pytest

from rig.commands.verify import verify_run
from rig.errors import RecordingError
from rig.recording import RecordingSettings
from tests.rig.recorder.test_recorder import START, record, step


def delete(path: Path) -> None:
    path.unlink()


def delete_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


def rename_folder(path: Path) -> None:
    path.parent.rename(path.parent.with_name("elsewhere"))


def replace(path: Path) -> None:
    copy = path.with_name("copy")
    shutil.copy(path, copy)
    copy.replace(path)


@pytest.mark.parametrize("remove", [delete, delete_folder, rename_folder, replace])
@pytest.mark.parametrize("noticed", ["in the run", "at the end"])
def test_run_file_that_is_gone_ends_the_run_and_its_data_are_where_the_sentence_says(
    tmp_path, monkeypatch, remove, noticed
):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs"
    folder.mkdir()
    recorder = record(folder / "run.h5", settings=RecordingSettings(sync_frames=1))
    step(recorder, 0)
    step(recorder, 1)
    remove(folder / "run.h5")
    if noticed == "in the run":
        with pytest.raises(RecordingError, match="expected the run file at this place, got a "):
            step(recorder, 2)
    with pytest.raises(RecordingError) as caught:
        recorder.close("failed" if noticed == "in the run" else "completed", "", START)
    said = str(caught.value)
    (place,) = {Path(each) for each in re.findall(r"(?:in|to) (\S+\.h5)", said)}
    problems = verify_run(place).problems
    assert all("digest" not in problem and "damaged" not in problem for problem in problems), problems
    assert any("failed" in problem for problem in problems)
    assert not place.stat().st_mode & 0o222


def emptied(path: Path) -> None:
    os.truncate(path, 0)


def cut(path: Path) -> None:
    os.truncate(path, 6000)


def copied_over(path: Path) -> None:
    other = record(path.with_name("other.h5"))
    step(other, 0)
    step(other, 1)
    step(other, 2)
    other.close("completed", "", START)
    path.write_bytes(path.with_name("other.h5").read_bytes())


@pytest.mark.parametrize("overwrite", [emptied, cut, copied_over])
@pytest.mark.parametrize("noticed", ["in the run", "at the end"])
def test_run_file_that_another_program_overwrites_ends_the_run_and_is_left_alone(
    tmp_path, overwrite, noticed
):
    path = tmp_path / "run.h5"
    recorder = record(path, settings=RecordingSettings(sync_frames=1))
    step(recorder, 0)
    path.chmod(0o644)
    overwrite(path)
    content = path.read_bytes()
    words = "expected the run file as it was written, got a file of .* so that the images and readings in it"
    if noticed == "in the run":
        with pytest.raises(RecordingError, match=words):
            step(recorder, 1)
    with pytest.raises(RecordingError, match=words):
        recorder.close("completed", "", START)
    # what the other program has written is the user's, and nothing is written over it
    assert path.read_bytes() == content


def test_run_file_is_read_only_while_it_is_written(tmp_path):
    recorder = record(tmp_path / "run.h5")
    step(recorder, 0)
    assert not (tmp_path / "run.h5").stat().st_mode & 0o222
    recorder.close("completed", "", START)


def test_run_file_in_its_place_is_closed_as_completed(tmp_path):
    recorder = record(tmp_path / "run.h5")
    step(recorder, 0)
    os.link(tmp_path / "run.h5", tmp_path / "second-name.h5")
    recorder.close("completed", "", START)
    assert verify_run(tmp_path / "run.h5").problems == verify_run(tmp_path / "second-name.h5").problems
