"""SHA-256 digests of a run file: one digest for each image, and one digest for all other bytes.

The digest of an image covers its pixels, row by row, in little-endian byte order. Each digest of an image is
stored in the table of the camera's images.

The digest of all other bytes is stored in the user block, the first `BLOCK_BYTES` bytes of the file, which
HDF5 skips; files of earlier versions have a block of 512 bytes. The user block is a text, which also holds a
copy of HDF5's superblock. The digest in the user block covers all bytes after the user block, except the
pixels of images that have a digest of their own. So every byte after the user block is covered by a digest,
and the pixels need not be read again when the file is closed.
"""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK_BYTES = 4096
"""A page of the operating system's memory, so that each of HDF5's pages behind the block is such a page."""

_TITLE = "offaxis run file; HDF5 begins at byte"
_PIECE_BYTES = 1 << 20
_BEGIN = re.compile(rf"{_TITLE} (512|{BLOCK_BYTES})\n")
_LINE = re.compile(r"(superblock|sha256) ([0-9a-f]+)")


@dataclass(frozen=True)
class UserBlock:
    """The user block of a run file: a text in the first bytes of the file, before the HDF5 data."""

    superblock: bytes
    """A copy of HDF5's superblock from the beginning of the recording."""
    sha256: str = ""
    """The digest of all bytes except pixels, as hexadecimal text; empty if the file was not closed."""
    size: int = BLOCK_BYTES
    """Number of bytes of the user block, where the HDF5 data begin."""

    def to_bytes(self) -> bytes:
        """Return the user block as it is written to the file, padded to its size."""
        lines = [f"{_TITLE} {self.size}", f"superblock {self.superblock.hex()}"]
        lines += [f"sha256 {self.sha256}"] if self.sha256 else []
        return ("\n".join(lines) + "\n").encode().ljust(self.size, b"\0")


def read_user_block(path: Path) -> UserBlock | None:
    """Return the user block of a run file, or None if the user block is missing or damaged."""
    with path.open("rb") as file:
        stored = file.read(BLOCK_BYTES)
    begin = _BEGIN.match(stored.decode("ascii", "replace"))
    if begin is None:
        return None
    stored = stored[: int(begin[1])]
    found = dict(_LINE.findall(stored.decode("ascii", "replace")))
    try:
        block = UserBlock(bytes.fromhex(found["superblock"]), found.get("sha256", ""), len(stored))
    except (KeyError, ValueError):
        return None
    return block if block.to_bytes() == stored else None


def frame_digest(image: NDArray[Any]) -> str:
    """Return the digest of an image's pixels."""
    little = image.dtype.newbyteorder("<")
    return hashlib.sha256(np.ascontiguousarray(image, little).data).hexdigest()


def joined_digest(digests: Iterable[str]) -> str:
    """Return the digest of several digests, such as those of the frames of a step."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def file_digest(path: Path, pixels: Iterable[tuple[int, int]], begin: int = BLOCK_BYTES) -> str:
    """Return the SHA-256 digest of all bytes after the user block, except the pixels of given images.

    `pixels`: first byte and number of bytes of each image whose pixels are left out, because the image has
    its own digest. `begin`: the first byte after the user block.
    """
    digest = hashlib.sha256()
    with path.open("rb") as file:
        position, end = begin, path.stat().st_size
        for first, size in [*sorted(pixels), (end, 0)]:
            file.seek(position)
            while position < min(first, end):
                piece = file.read(min(_PIECE_BYTES, first - position))
                if not piece:  # another program has shortened the file meanwhile
                    break
                digest.update(piece)
                position += len(piece)
            position = max(position, first + size)
    return digest.hexdigest()
