"""Changes of a file that are made as a whole, even if the program is killed or the power fails meanwhile.

The changes are first written behind the end of the file, with their digest. Then they are made, and cut off
again. If the program ends before the digest is written, the file has its earlier state, and HDF5 ignores what
is behind its end. If the program ends later, `complete` makes the changes again.
"""

import os
from collections.abc import Iterator, Mapping
from hashlib import sha256
from io import FileIO
from pathlib import Path
from struct import Struct
from typing import Any

_MAGIC = b"offaxis\x00changes\x00"
_END = Struct(f"<{len(_MAGIC)}sQ32s")
"""The end of a file with changes behind its end: a mark, the length of the changes, and their digest."""
_PLACE = Struct("<QQ")
"""Offset and length of a change."""


def overwrite(file: FileIO, size: int, changes: Mapping[tuple[int, int], bytes]) -> None:
    """Change bytes of an open file as a whole; `size` is the length that the file has afterwards.

    `file`: the file without a buffer of Python. `changes`: the new bytes by their offset and length, in the
    order in which they are written.

    Raises `OSError` if the disk is full. The file then has its earlier state.
    """
    packed = b"".join(_PLACE.pack(*place) + data for place, data in changes.items())
    try:
        # What was appended must be on the disk before an index names it.
        os.fsync(file.fileno())
        write_at(file, size, memoryview(packed + _END.pack(_MAGIC, len(packed), sha256(packed).digest())))
        os.fsync(file.fileno())
    except OSError:
        file.truncate(size)
        raise
    _change(file, size, _unpacked(packed))


def complete(path: Path) -> None:
    """Make the changes that another program could not finish, if the file has any behind its end.

    Raises `OSError` if the file must be changed and cannot be.
    """
    with path.open("rb") as file:
        found = _changes_behind(file)
    if found is not None:
        size, changes = found
        with path.open("r+b", buffering=0) as writable:
            _change(writable, size, changes)


def write_at(file: FileIO, offset: int, data: memoryview) -> None:
    """Write all bytes at a place of an open file."""
    file.seek(offset)
    done = 0
    while done < len(data):
        # A nearly full disk accepts a part of the data. The next attempt then raises the error.
        done += file.write(data[done:]) or 0


def _change(file: FileIO, size: int, changes: Iterator[tuple[int, bytes]]) -> None:
    for offset, data in changes:
        write_at(file, offset, memoryview(data))
    os.fsync(file.fileno())
    file.truncate(size)


def _unpacked(packed: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(packed):
        offset, length = _PLACE.unpack_from(packed, at)
        at += _PLACE.size
        yield offset, packed[at : at + length]
        at += length


def _changes_behind(file: Any) -> tuple[int, Iterator[tuple[int, bytes]]] | None:
    """Return the length of the file without the changes behind its end, and the changes; None without any."""
    length = file.seek(0, os.SEEK_END)
    if length < _END.size:
        return None
    file.seek(length - _END.size)
    magic, packed_length, digest = _END.unpack(file.read(_END.size))
    size = length - _END.size - packed_length
    if magic != _MAGIC or size < 0:
        return None
    file.seek(size)
    packed = file.read(packed_length)
    if sha256(packed).digest() != digest or any(
        offset + len(data) > size for offset, data in _unpacked(packed)
    ):
        return None
    return size, _unpacked(packed)
