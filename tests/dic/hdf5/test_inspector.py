"""One process inspects all HDF5 files, and a new process starts if it has ended."""

import os
import signal

import h5py
import pytest

from dic.hdf5 import inspector
from dic.hdf5.inspector import ask_inspector

PATIENCE_S = 60.0


@pytest.fixture
def good(tmp_path):
    path = tmp_path / "a file\nwith a strange name.h5"
    with h5py.File(path, "w") as file:
        file["numbers"] = [1, 2, 3]
    return path


def process():
    assert inspector._process is not None
    return inspector._process.pid


def test_one_process_inspects_file_after_file(good, tmp_path):
    bad = tmp_path / "bad.h5"
    bad.write_bytes(b"no HDF5")
    assert ask_inspector(good, PATIENCE_S) == (0, "")
    first = process()
    status, said = ask_inspector(bad, PATIENCE_S)
    assert (status, "no HDF5" in said) == (0, True)
    assert ask_inspector(good, PATIENCE_S) == (0, "")
    assert process() == first


def test_after_the_process_was_killed_another_answers(good):
    ask_inspector(good, PATIENCE_S)
    first = process()
    os.kill(first, signal.SIGKILL)
    assert ask_inspector(good, PATIENCE_S) == (0, "")
    assert process() != first


def test_an_inspection_that_takes_too_long_is_ended(good, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(TimeoutError):
        # nobody ever writes to the pipe
        ask_inspector(pipe, 0.01)
    assert inspector._process is None
    assert ask_inspector(good, PATIENCE_S) == (0, "")


def test_a_copy_of_the_program_starts_an_inspector_of_its_own(good, monkeypatch):
    ask_inspector(good, PATIENCE_S)
    first = process()
    monkeypatch.setattr(inspector, "_owner", os.getpid() + 1)
    try:
        assert ask_inspector(good, PATIENCE_S) == (0, "")
        assert process() != first
    finally:
        (other,) = inspector._of_others
        inspector._of_others.clear()
        other.kill()
        other.wait()
        other.stdin.close()
        other.stdout.close()
