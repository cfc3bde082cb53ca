"""A file that a program is writing has the state of a commit, whenever the program is killed."""

import random
from io import FileIO
from pathlib import Path
from typing import ClassVar

import h5py
import numpy as np

from dic.hdf5.commit import complete
from dic.hdf5.writing import NewFile

ROWS = 6


class Logged(FileIO):
    """A file that notes each change: an offset and the new bytes, or a new length."""

    changes: ClassVar[list[tuple[int, bytes | None]]] = []

    def write(self, data):
        Logged.changes.append((self.tell(), bytes(data)))
        return super().write(data)

    def truncate(self, size=None):
        Logged.changes.append((self.tell() if size is None else size, None))
        return super().truncate(size)


def write(path, rows=ROWS):
    """Append rows, and one attribute and one group with texts for each; commit after each."""
    file = NewFile(path)
    data = file.hdf5.create_dataset("data", (0, 40, 40), "f8", maxshape=(None, 40, 40), chunks=(1, 40, 40))
    texts = file.hdf5.create_dataset("texts", (0,), h5py.string_dtype(), maxshape=(None,), chunks=(4,))
    for n in range(rows):
        data.resize(n + 1, axis=0)
        data[n] = np.full((40, 40), n)
        texts.resize(n + 1, axis=0)
        texts[n] = f"row {n} " * n
        file.hdf5.create_group(f"group {n}").attrs["n"] = n
        file.commit()
    file.close()


def state(path):
    """Return the number of rows of a file, which must be those that `write` has committed."""
    with h5py.File(path) as file:
        if "data" not in file:
            return 0
        rows = len(file["data"])
        np.testing.assert_array_equal(file["data"][:, 0, 0], range(rows))
        assert [text.decode() for text in file["texts"]] == [f"row {n} " * n for n in range(rows)]
        assert sorted(name for name in file if name.startswith("group")) == [
            f"group {n}" for n in range(rows)
        ]
        return rows


def killed(changes, count, share):
    """Return the bytes of a file after the first `count` changes, and a part of the next one."""
    content = bytearray()
    for offset, data in changes[:count]:
        if data is None:
            content = content[:offset].ljust(offset, b"\0")
        else:
            content[len(content) :] = bytes(max(0, offset - len(content)))
            content[offset : offset + len(data)] = data
    offset, data = changes[count]
    part = (data or b"")[: int(share * len(data or b""))]
    content[len(content) :] = bytes(max(0, offset - len(content)) if part else 0)
    content[offset : offset + len(part)] = part
    return bytes(content)


def test_file_has_the_state_of_a_commit_whenever_the_program_is_killed(monkeypatch, tmp_path):
    opened = Path.open

    def logging(path, mode="r", *rest, **named):
        return Logged(path, "w+") if mode == "w+b" else opened(path, mode, *rest, **named)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", logging)
        write(tmp_path / "whole.h5")
    assert state(tmp_path / "whole.h5") == ROWS
    changes, found = Logged.changes, []
    share = random.Random(4).random
    for count in range(len(changes)):
        path = tmp_path / "killed.h5"
        path.write_bytes(killed(changes, count, share()))
        try:
            complete(path)
            found.append(state(path))
        except OSError:
            # Before the first commit, the file has no name yet that anybody knows.
            assert not found
    assert found == sorted(found)
    assert set(range(1, ROWS)) <= set(found)


def test_changes_behind_the_end_of_a_foreign_file_are_left_alone(tmp_path):
    path = tmp_path / "r.h5"
    write(path)
    before = path.read_bytes() + bytes(100)
    path.write_bytes(before)
    complete(path)
    assert path.read_bytes() == before
