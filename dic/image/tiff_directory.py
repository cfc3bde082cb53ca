"""Read the directories of TIFF and BigTIFF files: their entries, and the places of all pages (TIFF 6.0)."""

import struct
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from dic.files.reading import Content, FileContent
from dic.image.container import Damage

SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
INTEGERS = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""The codes of `struct` for the kinds of entries that hold whole numbers."""
WIDTH, HEIGHT, BITS, COMPRESSION, ORIENTATION, SAMPLES = 256, 257, 258, 259, 274, 277
STRIPS_AND_TILES = ((273, 279), (324, 325))
"""For strips and for tiles, the tag of their places and the tag of their sizes."""
_KIND_OF_PAGE = 254
_SMALLER_OR_MASK = 0b101
"""Bits of the tag NewSubfileType that mark a page as a smaller copy or as a mask of another page."""
_NEEDED = {WIDTH, HEIGHT, BITS, COMPRESSION, SAMPLES, *STRIPS_AND_TILES[0], *STRIPS_AND_TILES[1]}
_MOST_PAGES = 100_000
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 16: 8}
"""Bytes of one value of each kind of entry."""


class Entry(NamedTuple):
    """One entry of a TIFF directory: tag, kind and number of values, and the values as stored."""

    tag: int
    kind: int
    number: int
    stored: bytes


_of_files: OrderedDict[tuple[int, ...], list[int]] = OrderedDict()
"""The pages of the files that were read last, by the identities of the files."""
_KEPT_FILES = 8


def pages_of_file(content: FileContent) -> list[int]:
    """Return the result of `page_directories`, which is computed once per file.

    A series reads the pages of a stack one by one, and each search follows the chain of all directories. If
    every page needed a search, the time of a series would grow with the square of its number of images.
    """
    pages = _of_files.get(content.identity)
    if pages is None:
        pages = _of_files[content.identity] = page_directories(content)
        while len(_of_files) > _KEPT_FILES:
            _of_files.popitem(last=False)
    return pages


def page_directories(content: Content) -> list[int]:
    """Return the positions of the directories of all pages, without smaller copies and masks of pages."""
    order = byte_order(content)
    pages: dict[int, bool] = {}
    at = first_directory(content)
    while at and at not in pages and len(pages) < _MOST_PAGES:
        try:
            kind = integers(read_entries(content, at, (_KIND_OF_PAGE,)), order).get(_KIND_OF_PAGE, (0,))[0]
            first, entries = _directory(content, at)
            _, offset_code, _, entry_bytes = _layout(content)
            (following,) = _unpack(order + offset_code, content, first + entries * entry_bytes)
        except (struct.error, Damage):
            # The file ends before the end of the chain of directories. The reader of this page checks whether
            # the page is whole.
            pages[at] = True
            break
        pages[at] = not kind & _SMALLER_OR_MASK
        at = following
    # If the tags mark every page as a copy or a mask, the tags are wrong. Then return all pages.
    return [place for place, whole in pages.items() if whole] or list(pages)


def read_entries(content: Content, at: int, wanted: Sequence[int] = ()) -> list[Entry]:
    """Return the entries of the directory at a position: all, or those with the wanted tags.

    Raises
    ------
    Damage
        If the values of the entries overlap, which would make a small file fill the memory.
    struct.error
        If the file was cut off.
    """
    return [entry for entry in _entries(content, at, wanted) if entry.number > 0]


def integers(entries: Sequence[Entry], order: str) -> dict[int, tuple[int, ...]]:
    """Return the values of those entries that hold whole numbers."""
    return {
        entry.tag: struct.unpack(f"{order}{entry.number}{INTEGERS[entry.kind]}", entry.stored)
        for entry in entries
        if entry.kind in INTEGERS
    }


def byte_order(content: Content) -> str:
    """Return the byte order of a TIFF file as `struct` writes it."""
    return "<" if content[:1] == b"I" else ">"


def first_directory(content: Content) -> int:
    """Return the position of the first page's directory."""
    order, offset_code, _, _ = _layout(content)
    return int(_unpack(order + offset_code, content, 8 if offset_code == "Q" else 4)[0])


def _entries(content: Content, at: int, wanted: Sequence[int]) -> Iterator[Entry]:
    order, offset_code, _, entry_bytes = _layout(content)
    value_bytes = struct.calcsize(order + offset_code)
    first, entries = _directory(content, at)
    total = 0
    for place in range(first, first + entries * entry_bytes, entry_bytes):
        tag, kind, count = _unpack(order + "HH" + offset_code, content, place)
        if kind not in _SIZES or (wanted and tag not in wanted):
            continue
        inline, size = place + entry_bytes - value_bytes, count * _SIZES[kind]
        where = inline if size <= value_bytes else _unpack(order + offset_code, content, inline)[0]
        stored = content[where : where + size]
        total += len(stored)
        if total > len(content):
            raise Damage("a TIFF whose tags overlap")
        if len(stored) == size:
            yield Entry(tag, kind, count, stored)
        elif tag in _NEEDED:
            raise struct.error("values beyond the end of the file")


def _layout(content: Content) -> tuple[str, str, str, int]:
    """Return the byte order, the `struct` codes of an offset and of an entry count, and the entry size."""
    order = byte_order(content)
    return (order, "Q", "Q", 20) if content[2:4] in (b"+\0", b"\0+") else (order, "I", "H", 12)


def _directory(content: Content, at: int) -> tuple[int, int]:
    """Return the position of the first entry and the number of entries of the TIFF directory at `at`."""
    order, _, count_code, _ = _layout(content)
    (entries,) = _unpack(order + count_code, content, at)
    return at + struct.calcsize(order + count_code), entries


def _unpack(code: str, content: Content, at: int) -> tuple[int, ...]:
    return struct.unpack(code, content[at : at + struct.calcsize(code)])
