"""The superblock of an HDF5 file, which says whether the file is open for writing, and how long it is.

HDF5 refuses to open a file if its writer was killed, or if the file is shorter than its superblock says. This
module repairs such files. The repair changes only the superblock and no other byte. Source: HDF5 File Format
Specification 4.0, section II.A (version 2 and 3 of the superblock).
"""

import os
import struct
from dataclasses import dataclass, replace
from pathlib import Path

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SUPERBLOCK_BYTES = 48

_FIELDS = struct.Struct("<8sBBBBQQQQ")
_VERSION = 3
_ADDRESS_BYTES = 8
_MASK = 0xFFFFFFFF
_SEARCHED_BYTES = 1 << 20


@dataclass(frozen=True)
class Superblock:
    """The fields of an HDF5 superblock."""

    flags: int
    """Bit 0: open for writing. Bit 2: written in SWMR mode."""
    base: int
    extension: int
    end: int
    root: int
    """Addresses of the first byte of the HDF5 data, of the superblock's extension, of the end of the file,
    and of the root group.
    """

    def to_bytes(self) -> bytes:
        """Return the 48 bytes of the superblock in a file, including its checksum."""
        fields = _FIELDS.pack(
            SIGNATURE,
            _VERSION,
            _ADDRESS_BYTES,
            _ADDRESS_BYTES,
            self.flags,
            self.base,
            self.extension,
            self.end,
            self.root,
        )
        return fields + struct.pack("<I", checksum(fields))


def parse(content: bytes) -> Superblock:
    """Return the superblock that is stored in the given 48 bytes.

    Raises `ValueError` if the bytes are not a superblock of version 3, or if the checksum is wrong.
    """
    if len(content) != SUPERBLOCK_BYTES:
        raise ValueError("a superblock that was cut off")
    signature, version, *sizes, flags, base, extension, end, root = _FIELDS.unpack(content[:-4])
    if signature != SIGNATURE:
        raise ValueError("no superblock of HDF5")
    if version != _VERSION or sizes != [_ADDRESS_BYTES, _ADDRESS_BYTES]:
        raise ValueError(f"a superblock of version {version}")
    if struct.pack("<I", checksum(content[:-4])) != content[-4:]:
        raise ValueError("a superblock with a wrong checksum")
    return Superblock(flags, base, extension, end, root)


def find(path: Path) -> int | None:
    """Return the position of the superblock: byte 0, 512, 1024, 2048, …; None if there is no superblock."""
    place = 0
    with path.open("rb") as file:
        while place <= _SEARCHED_BYTES:
            file.seek(place)
            if file.read(len(SIGNATURE)) == SIGNATURE:
                return place
            place = max(512, 2 * place)
    return None


def is_closed(path: Path) -> bool:
    """Return True if the file is marked as closed and has the length that its superblock says."""
    place = find(path)
    if place is None:
        return False
    with path.open("rb") as file:
        file.seek(place)
        try:
            found = parse(file.read(SUPERBLOCK_BYTES))
        except ValueError:
            return False
    return found.flags == 0 and found.end == path.stat().st_size


def mark_closed(path: Path, opened: int | None = None) -> bool:
    """Repair the superblock of a file that was not closed; return False if no repair was necessary.

    The flags are set to "closed", and the stored length is set to the length of the file. No byte outside the
    superblock is changed. `opened` is a descriptor of the file that may write to it, if the caller has one.

    Raises `ValueError` if the file has no superblock of version 3, or if the checksum of the superblock is
    wrong, and `OSError` if the file cannot be read or written.
    """
    place = find(path)
    if place is None:
        raise ValueError("no superblock of HDF5")
    descriptor = os.open(path, os.O_RDWR) if opened is None else os.dup(opened)
    try:
        found = parse(os.pread(descriptor, SUPERBLOCK_BYTES, place))
        closed = replace(found, flags=0, end=os.fstat(descriptor).st_size)
        if closed == found:
            return False
        write(descriptor, place, closed)
        return True
    finally:
        os.close(descriptor)


def write(descriptor: int, place: int, superblock: Superblock) -> None:
    """Write a superblock and wait until it is on the disk."""
    os.pwrite(descriptor, superblock.to_bytes(), place)
    os.fsync(descriptor)


def checksum(content: bytes) -> int:
    """Return HDF5's checksum of metadata: Jenkins' lookup3 ("hashlittle"), beginning with 0."""
    a = b = c = (0xDEADBEEF + len(content)) & _MASK
    padded = content + bytes(-len(content) % 12) if content else bytes(12)
    *blocks, (x, y, z) = struct.iter_unpack("<3I", padded)
    for p, q, r in blocks:
        a, b, c = _mix((a + p) & _MASK, (b + q) & _MASK, (c + r) & _MASK)
    if not content:
        return c
    return _final((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)


def _rotate(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK


def _mix(a: int, b: int, c: int) -> tuple[int, int, int]:
    a = ((a - c) & _MASK) ^ _rotate(c, 4)
    c = (c + b) & _MASK
    b = ((b - a) & _MASK) ^ _rotate(a, 6)
    a = (a + c) & _MASK
    c = ((c - b) & _MASK) ^ _rotate(b, 8)
    b = (b + a) & _MASK
    a = ((a - c) & _MASK) ^ _rotate(c, 16)
    c = (c + b) & _MASK
    b = ((b - a) & _MASK) ^ _rotate(a, 19)
    a = (a + c) & _MASK
    c = ((c - b) & _MASK) ^ _rotate(b, 4)
    b = (b + a) & _MASK
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    c = ((c ^ b) - _rotate(b, 14)) & _MASK
    a = ((a ^ c) - _rotate(c, 11)) & _MASK
    b = ((b ^ a) - _rotate(a, 25)) & _MASK
    c = ((c ^ b) - _rotate(b, 16)) & _MASK
    a = ((a ^ c) - _rotate(c, 4)) & _MASK
    b = ((b ^ a) - _rotate(a, 14)) & _MASK
    return ((c ^ b) - _rotate(b, 24)) & _MASK
