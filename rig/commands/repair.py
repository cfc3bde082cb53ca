"""Repair a run file that HDF5 refuses to open because the recording program did not close it."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from dic.errors import RunFileError
from dic.runfile import superblock
from dic.runfile.digests import read_user_block
from dic.runfile.lock import is_recorded
from dic.runfile.reader import RunFile
from dic.runfile.superblock import SUPERBLOCK_BYTES, Superblock

_GROWTH_MAX = 1 << 40


@dataclass(frozen=True)
class Repair:
    """The result of a repair.

    Attributes
    ----------
    changes : list of str
        One sentence for each change. The list is empty if there was nothing to repair.
    """

    path: Path
    changes: list[str]


def repair_run(path: str | Path) -> Repair:
    """Repair a run file so that HDF5 opens it again.

    The repair changes only HDF5's superblock: 48 bytes that state the length of the file and whether it is
    open for writing. No table and no image is changed. If the file still cannot be read, the old 48 bytes are
    restored.

    Raises
    ------
    RunFileError
        If a program is recording the file, or the file cannot be repaired.
    """
    path = Path(path)
    if not path.is_file():
        raise _refusal(path, "no such file", "name a file written by `rig run`")
    try:
        if is_recorded(path):
            raise _refusal(path, "a run that is being recorded", "wait for the end of the run")
        with _writable(path):
            return Repair(path, _repair(path))
    except OSError as error:
        got = f"a file that cannot be changed ({error.strerror or error})"
        raise _refusal(path, got, "copy it to a folder where you may write") from error


def _repair(path: Path) -> list[str]:
    place = superblock.find(path)
    found = None if place is None else _parsed(path, place)
    copy = _copied(path)
    changes = []
    if found is None:
        if copy is None:
            raise _refusal(
                path, "no superblock, and no copy of one", "take a copy of the file, if there is one"
            )
        place, found = copy
        changes.append("the superblock was damaged and was restored from its copy in the file")
    assert place is not None
    size = path.stat().st_size
    if found.flags:
        changes.append("the file was marked as open for writing")
    if found.end != size:
        changes.append(f"the file should have had {found.end} bytes and has {size}")
    if not changes:
        _require_readable(path)
        return []
    # If the end of the file is lost, a table may be cut off. Then the file must get its old length again.
    # HDF5 reads zeros in place of the lost bytes.
    lengths = [size, found.end] if size < found.end < size + _GROWTH_MAX else [size]
    for length in lengths:
        if _try(path, place, replace(found, flags=0, end=length), last=length == lengths[-1]):
            break
    return changes


def _try(path: Path, place: int, repaired: Superblock, *, last: bool) -> bool:
    """Write a superblock into the file. Restore the old one if HDF5 still cannot read the file."""
    descriptor = os.open(path, os.O_RDWR)
    try:
        size = os.fstat(descriptor).st_size
        before = os.pread(descriptor, SUPERBLOCK_BYTES, place)
        if repaired.end > size:
            os.ftruncate(descriptor, repaired.end)
        superblock.write(descriptor, place, repaired)
        try:
            _require_readable(path)
        except RunFileError:
            os.pwrite(descriptor, before, place)
            os.ftruncate(descriptor, size)
            os.fsync(descriptor)
            if last:
                raise
            return False
        return True
    finally:
        os.close(descriptor)


def _require_readable(path: Path) -> None:
    with RunFile(path):
        pass


def _parsed(path: Path, place: int) -> Superblock | None:
    with path.open("rb") as file:
        file.seek(place)
        try:
            return superblock.parse(file.read(SUPERBLOCK_BYTES))
        except ValueError:
            return None


def _copied(path: Path) -> tuple[int, Superblock] | None:
    """Return the position and the content of HDF5's superblock, from the copy in the file's user block."""
    block = read_user_block(path)
    try:
        return None if block is None else (len(block.to_bytes()), superblock.parse(block.superblock))
    except ValueError:
        return None


@contextmanager
def _writable(path: Path) -> Iterator[None]:
    """Make a run file writable during the repair, because a closed run file is read-only."""
    mode = stat.S_IMODE(path.stat().st_mode)
    changed = not os.access(path, os.W_OK)
    if changed:
        path.chmod(mode | stat.S_IWUSR)
    try:
        yield
    finally:
        if changed:
            path.chmod(mode)


def _refusal(path: Path, got: str, remedy: str) -> RunFileError:
    return RunFileError(str(path), "repair run", "a run file that can be repaired", got, remedy)
