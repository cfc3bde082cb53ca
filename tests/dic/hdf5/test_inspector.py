"""One process inspects all HDF5 files, and a new process starts if it has ended."""

import os
import platform
import signal
import struct

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


def lookup3(data: bytes) -> int:
    """Return HDF5's checksum of some bytes (B. Jenkins, lookup3, in the public domain)."""

    def turned(value: int, by: int) -> int:
        return value << by | value >> 32 - by

    words = struct.unpack(f"<{-(-len(data) // 12) * 3}I", data + bytes(-len(data) % 12))
    a = b = c = 0xDEADBEEF + len(data)
    for at in range(0, len(words), 3):
        a, b, c = (a + words[at]) % 2**32, (b + words[at + 1]) % 2**32, (c + words[at + 2]) % 2**32
        if at + 3 < len(words):
            for by in (4, 6, 8, 16, 19, 4):
                a, b, c = b, (c + b) % 2**32, ((a - c) ^ turned(c, by)) % 2**32
    for by in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, ((c ^ b) - turned(b, by)) % 2**32, a
    return b


@pytest.mark.skipif(platform.machine() != "x86_64", reason="other processors divide by zero without a signal")
def test_file_that_crashes_hdf5_ends_only_the_inspection(good, tmp_path):
    """A tree of names states records of zero bytes, and HDF5 divides by this size."""
    path = tmp_path / "crash.h5"
    with h5py.File(path, "w", libver="latest") as file:
        for number in range(12):
            file[f"numbers{number}"] = [1, 2, 3]
    content = bytearray(path.read_bytes())
    at = content.index(b"BTHD")
    assert lookup3(content[at : at + 34]) == struct.unpack_from("<I", content, at + 34)[0]
    struct.pack_into("<H", content, at + 10, 0)
    struct.pack_into("<I", content, at + 34, lookup3(content[at : at + 34]))
    path.write_bytes(content)
    assert ask_inspector(path, PATIENCE_S) == (-signal.SIGFPE, "")
    assert ask_inspector(good, PATIENCE_S) == (0, "")


@pytest.mark.extended
def test_file_that_keeps_hdf5_busy_for_ever_ends_only_the_inspection(good, tmp_path):
    """One changed byte, the length of a text: HDF5 looks for the next text among zeros, without an end."""
    path = tmp_path / "busy.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update(first="some words", second="some words", third="some words")
    content = bytearray(path.read_bytes())
    first = content.index(b"GCOL") + 16
    second = first + 16 + 16
    assert struct.unpack_from("<H6xQ", content, second) == (2, len("some words"))
    content[second + 8] = 200
    path.write_bytes(content)
    assert ask_inspector(path, PATIENCE_S) == (-signal.SIGXCPU, "")
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
