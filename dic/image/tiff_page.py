"""Write one page of a TIFF file as a TIFF file of its own, with only the tags that describe the pixels."""

import struct
from collections.abc import Sequence
from itertools import accumulate

from dic.image.tiff_directory import INTEGERS, STRIPS_AND_TILES, Entry

_LONG, _LONG8 = 4, 16
_OF_PIXELS = {
    256, 257, 258, 259, 262, 266, 273, 277, 278, 279, 284, 292, 293, 317,
    320, 322, 323, 324, 325, 338, 339, 347, 529, 530, 531, 532,
}  # fmt: skip
"""Tags that say how the pixels are stored (TIFF 6.0, and technical note 2 for the JPEG tables)."""
_HEADER_BYTES, _INLINE_BYTES = 8, 4


def single_page(order: str, entries: Sequence[Entry], pieces: Sequence[bytes]) -> bytes:
    """Return a TIFF file of one page.

    Parameters
    ----------
    order : str
        Byte order of the stored values, "<" or ">".
    entries : sequence of Entry
        The entries of the page's directory.
    pieces : sequence of bytes
        The strips or tiles of the page, in order.
    """
    sizes = [len(piece) for piece in pieces]
    *places, end = accumulate(sizes, initial=_HEADER_BYTES)
    values, directory = bytearray(end % 2), b""
    kept = sorted(_with_places(order, entries, places, sizes))
    for tag, kind, count, stored in kept:
        if len(stored) > _INLINE_BYTES:
            where = struct.pack(order + "I", end + len(values))
            values += stored + bytes(len(stored) % 2)
        else:
            where = stored.ljust(_INLINE_BYTES, b"\0")
        directory += struct.pack(order + "HHI", tag, kind, count) + where
    header = struct.pack(order + "2sHI", b"II" if order == "<" else b"MM", 42, end + len(values))
    number = struct.pack(order + "H", len(kept))
    # The pixels may be hundreds of megabytes, so they are copied only once.
    return b"".join([header, *pieces, values, number, directory, bytes(_INLINE_BYTES)])


def _with_places(
    order: str, entries: Sequence[Entry], places: Sequence[int], sizes: Sequence[int]
) -> list[Entry]:
    """Return the entries of the pixels, with the new places and sizes of strips or tiles."""
    kept = []
    for entry in entries:
        if entry.tag in _OF_PIXELS and entry.tag not in _NEW_VALUES:
            kept.append(_short(order, entry))
    tags = {entry.tag for entry in entries}
    for pair in STRIPS_AND_TILES:
        if tags.issuperset(pair):
            for tag, values in zip(pair, (places, sizes), strict=True):
                kept.append(Entry(tag, _LONG, len(values), struct.pack(f"{order}{len(values)}I", *values)))
            break
    return kept


_NEW_VALUES = {tag for pair in STRIPS_AND_TILES for tag in pair}


def _short(order: str, entry: Entry) -> Entry:
    """Return the entry with its 64-bit values, which only BigTIFF has, converted to 32 bits."""
    if entry.kind != _LONG8:
        return entry
    values = struct.unpack(f"{order}{entry.number}{INTEGERS[_LONG8]}", entry.stored)
    return Entry(entry.tag, _LONG, entry.number, struct.pack(f"{order}{entry.number}I", *values))
