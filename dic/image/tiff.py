"""Check TIFF and BigTIFF files before decoding: strips, checksums, declared size and pages (TIFF 6.0)."""

import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from dic.image.container import Container, Damage, inflated_bytes, require_bounded

SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_INTEGERS = {1: "B", 3: "H", 4: "I", 16: "Q"}
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _ORIENTATION, _SAMPLES = 256, 257, 258, 259, 274, 277
_STRIPS_AND_TILES = ((273, 279), (324, 325))
_DEFLATE = (8, 32946)
_WANTED = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _ORIENTATION, _SAMPLES}
_WANTED |= {tag for pair in _STRIPS_AND_TILES for tag in pair}
_MOST_PAGES = 100_000

Tags = Mapping[int, tuple[int, ...]]


def read_tiff(content: bytes) -> Container:
    """Check a TIFF file and read the tags of its first page.

    Raises
    ------
    Damage
        If a strip or tile of pixels lies beyond the end of the file or has a wrong checksum, or if the
        declared image is far too large.
    struct.error
        If the file was cut off within its directory of tags.
    """
    tags = _tags(content)
    pieces = _pieces(content, tags)
    bits = tags.get(_BITS, (1,))
    samples = max(tags.get(_SAMPLES, (1,))[0], len(bits))
    width, height = (tags.get(tag, (0,))[0] for tag in (_WIDTH, _HEIGHT))
    container = Container(
        _upright(content), width, height, max(max(bits), 8) * samples, orientation(content), _pages(content)
    )
    require_bounded(container, len(content))
    if tags.get(_COMPRESSION, (1,))[0] in _DEFLATE:
        _require_inflatable(pieces, 2 * width * height * container.pixel_bits // 8 + 2**20)
    return container


def orientation(content: bytes) -> int:
    """Return the orientation tag of a TIFF file or Exif block, 1 to 8, or 1 without a valid tag."""
    try:
        found = _tags(content).get(_ORIENTATION, (1,))[0]
    except struct.error:
        return 1
    return found if 1 <= found <= 8 else 1


def _upright(content: bytes) -> bytes:
    """Return the content of the TIFF file with the orientation tag set to 1, which means upright."""
    places = [entry.at for entry in _entries(content) if entry.tag == _ORIENTATION and entry.kind == 3]
    if not places:
        return content
    order = _layout(content)[0]
    changed = bytearray(content)
    for at in places:
        struct.pack_into(order + "H", changed, at, 1)
    return bytes(changed)


class _Entry(NamedTuple):
    """One entry of a TIFF directory; `at` is the position of the entry's values in the file."""

    tag: int
    kind: int
    values: int
    at: int


def _entries(content: bytes) -> Iterator[_Entry]:
    """Yield those entries of the first page's directory that this module needs, if they are whole numbers."""
    order, offset_code, _, entry_bytes = _layout(content)
    value_bytes = struct.calcsize(order + offset_code)
    first, entries = _directory(content, _first_directory(content))
    for at in range(first, first + entries * entry_bytes, entry_bytes):
        tag, kind, count = struct.unpack_from(order + "HH" + offset_code, content, at)
        if tag in _WANTED and kind in _INTEGERS and count > 0:
            inline = at + entry_bytes - value_bytes
            fits = count * struct.calcsize(order + _INTEGERS[kind]) <= value_bytes
            where = inline if fits else struct.unpack_from(order + offset_code, content, inline)[0]
            yield _Entry(tag, kind, count, where)


def _tags(content: bytes) -> dict[int, tuple[int, ...]]:
    order = _layout(content)[0]
    return {
        entry.tag: struct.unpack_from(f"{order}{entry.values}{_INTEGERS[entry.kind]}", content, entry.at)
        for entry in _entries(content)
    }


def _pieces(content: bytes, tags: Tags) -> list[bytes]:
    for offsets, counts in _STRIPS_AND_TILES:
        places = list(zip(tags.get(offsets, ()), tags.get(counts, ()), strict=False))
        if any(start + size > len(content) for start, size in places):
            raise Damage(f"a TIFF that was cut off after {len(content)} bytes")
        if places:
            return [content[start : start + size] for start, size in places]
    raise Damage("a TIFF without pixels")


def _require_inflatable(pieces: list[bytes], most_bytes: int) -> None:
    """Check the checksum at the end of each deflated strip or tile; image decoders skip this check."""
    try:
        for piece in pieces:
            most_bytes -= inflated_bytes([piece], most_bytes)
            if most_bytes < 0:
                raise Damage("a TIFF with more pixels than it declares")
    except zlib.error as error:
        raise Damage("a TIFF with damaged pixels") from error


def _layout(content: bytes) -> tuple[str, str, str, int]:
    """Return the byte order, the `struct` codes of an offset and of an entry count, and the entry size."""
    order = "<" if content[:1] == b"I" else ">"
    return (order, "Q", "Q", 20) if content[2:4] in (b"+\0", b"\0+") else (order, "I", "H", 12)


def _first_directory(content: bytes) -> int:
    order, offset_code, _, _ = _layout(content)
    return int(struct.unpack_from(order + offset_code, content, 8 if offset_code == "Q" else 4)[0])


def _directory(content: bytes, at: int) -> tuple[int, int]:
    """Return the position of the first entry and the number of entries of the TIFF directory at `at`."""
    order, _, count_code, _ = _layout(content)
    (entries,) = struct.unpack_from(order + count_code, content, at)
    return at + struct.calcsize(order + count_code), entries


def _pages(content: bytes) -> int:
    order, offset_code, _, entry_bytes = _layout(content)
    seen: set[int] = set()
    at = _first_directory(content)
    while at and at not in seen and len(seen) < _MOST_PAGES:
        seen.add(at)
        try:
            first, entries = _directory(content, at)
            (at,) = struct.unpack_from(order + offset_code, content, first + entries * entry_bytes)
        except struct.error:
            break
    return len(seen)
