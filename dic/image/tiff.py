"""Check the pages of TIFF and BigTIFF files before decoding: strips, checksums, declared size (TIFF 6.0)."""

import re
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

from dic.files.reading import MOST_IMAGE_BYTES, Content, FileContent
from dic.image.container import Container, Damage, inflated_bytes, require_bounded
from dic.image.tiff_directory import (
    BITS,
    COMPRESSION,
    HEIGHT,
    ORIENTATION,
    SAMPLES,
    STRIPS_AND_TILES,
    WIDTH,
    Entry,
    byte_order,
    first_directory,
    integers,
    pages_of_file,
    read_entries,
)
from dic.image.tiff_page import single_page

_DESCRIPTION = 270
_DEFLATE = (8, 32946)
_JPEG = (6, 7, 34892)
_IMAGEJ = re.compile(rb"ImageJ=.*?^images=(\d+)", re.DOTALL | re.MULTILINE)

Tags = Mapping[int, tuple[int, ...]]


def read_tiff(content: FileContent, page: int = 1) -> Container:
    """Check a page of a TIFF file and read its tags; pages count from 1.

    The container has only this page and the tags that the decoder needs, because decoders print messages
    about other tags.

    Raises
    ------
    Damage
        If the file does not have this page, if a strip or tile of pixels lies beyond the end of the file or
        has a wrong checksum, if strips or tags overlap, or if the declared image is far too large.
    struct.error
        If the file was cut off within its directory of tags.
    """
    pages = pages_of_file(content)
    if page > len(pages):
        if not pages:
            raise Damage("a TIFF without pages, which was not written to its end", "save or copy it again")
        raise Damage(f"a TIFF with {len(pages)} pages", f"name a page from 1 to {len(pages)}")
    entries = read_entries(content, pages[page - 1])
    order = byte_order(content)
    tags = integers(entries, order)
    _require_pages_of_imagej(entries, len(pages))
    places = _places(content, tags)
    bits = tags.get(BITS, (1,))
    samples = max(tags.get(SAMPLES, (1,))[0], len(bits))
    width, height = (tags.get(tag, (0,))[0] for tag in (WIDTH, HEIGHT))
    compression = tags.get(COMPRESSION, (1,))[0]
    container = Container(
        b"",
        width,
        height,
        max(max(bits), 8) * samples,
        _orientation(tags),
        len(pages),
        lossy=compression in _JPEG,
    )
    require_bounded(container, len(content))
    pieces = [content[start : start + size] for start, size in places]
    if compression in _DEFLATE:
        _require_inflatable(pieces, 2 * width * height * container.pixel_bits // 8 + 2**20)
    return replace(container, content=single_page(order, entries, pieces))


def orientation(content: Content) -> int:
    """Return the orientation tag of a TIFF file or Exif block, 1 to 8, or 1 without a valid tag."""
    try:
        entries = read_entries(content, first_directory(content), (ORIENTATION,))
    except (struct.error, Damage):
        return 1
    return _orientation(integers(entries, byte_order(content)))


def _orientation(tags: Tags) -> int:
    found = tags.get(ORIENTATION, (1,))[0]
    return found if 1 <= found <= 8 else 1


def _require_pages_of_imagej(entries: Sequence[Entry], pages: int) -> None:
    """Raise an error for a large stack of ImageJ, in which only the first page has a directory."""
    described = [entry.stored for entry in entries if entry.tag == _DESCRIPTION]
    found = _IMAGEJ.match(described[0]) if described else None
    if found is not None and int(found[1]) > pages:
        raise Damage(
            f"a stack of ImageJ with {int(found[1])} images and directories for {pages}",
            "save its images one by one, by ImageJ's Image Sequence",
        )


def _places(content: Content, tags: Tags) -> list[tuple[int, int]]:
    """Return the position and the size of each strip or tile, in bytes."""
    for offsets, counts in STRIPS_AND_TILES:
        places = list(zip(tags.get(offsets, ()), tags.get(counts, ()), strict=False))
        if any(start + size > len(content) for start, size in places):
            raise Damage(f"a TIFF that was cut off after {len(content)} bytes")
        total = sum(size for _, size in places)
        # Strips that share their bytes would make a small file fill the memory.
        if total > len(content):
            raise Damage(f"a TIFF whose strips overlap: {total} bytes in a file of {len(content)} bytes")
        if total > MOST_IMAGE_BYTES:
            raise Damage(f"a page of {total / 2**20:.0f} MB, more than {MOST_IMAGE_BYTES // 2**20} MB")
        if places:
            return places
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
