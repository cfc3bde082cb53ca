"""Check one page of a TIFF file, and write it as a TIFF file of its own for the decoder (TIFF 6.0)."""

import re
import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from typing import TYPE_CHECKING

from dic.files.reading import MOST_IMAGE_BYTES, FileContent
from dic.image.container import Container, Damage, inflated_bytes, require_bounded
from dic.image.tiff import opened_page, orientation, pages_of_file, stored_tags

if TYPE_CHECKING:
    from tifffile import TiffPage

_STRIPS_AND_TILES = ((273, 279), (324, 325))
"""For strips and for tiles, the tag of their places and the tag of their sizes."""
_OF_PIXELS = {
    256, 257, 258, 259, 262, 266, 277, 278, 284, 292, 293, 317,
    320, 322, 323, 338, 339, 347, 529, 530, 531, 532,
}  # fmt: skip
"""Tags that say how the pixels are stored (TIFF 6.0, and technical note 2 for the JPEG tables)."""
_DEFLATE = (8, 32946)
_JPEG = (6, 7, 34892)
_LONG, _LONG8 = 4, 16
_SEPARATE = 2
_IMAGEJ = re.compile(r"ImageJ=.*?^images=(\d+)", re.DOTALL | re.MULTILINE)


def read_tiff(content: FileContent, number: int = 1) -> Container:
    """Check a page of a TIFF file and read its tags; pages count from 1.

    The container has only this page and the tags that the decoder needs, because decoders print messages
    about other tags.

    Raises `Damage` if the file does not have this page, if it was cut off, if a strip or tile of pixels has a
    wrong checksum, if strips or tags overlap, or if the declared image is far too large.
    """
    pages = pages_of_file(content)
    if number > len(pages):
        if not pages:
            raise Damage("a TIFF without pages, which was not written to its end")
        raise Damage(f"a TIFF with {len(pages)} pages", f"name a page from 1 to {len(pages)}")
    with opened_page(content, pages[number - 1]) as page:
        if sum(tag.valuebytecount for tag in page.tags) > len(content):
            raise Damage("a TIFF whose tags overlap")
        needed = _OF_PIXELS.union(*_STRIPS_AND_TILES)
        if any(tag in needed and tag not in page.tags for tag in stored_tags(content, page)[0]):
            raise Damage(f"a file that was cut off after {len(content)} bytes")
        _require_pages_of_imagej(page, len(pages))
        places = _places(page, len(content))
        bits = page.tags.valueof(258, default=1)
        all_bits = bits if isinstance(bits, tuple) else (bits,)
        if page.planarconfig == _SEPARATE and page.samplesperpixel > 1 and max(all_bits) > 8:
            # OpenCV takes pixels from memory that nobody has written.
            raise Damage(
                "a TIFF with separate planes for the colours", "save it with the colours of a pixel together"
            )
        container = Container(
            b"",
            int(page.imagewidth),
            int(page.imagelength),
            max(*all_bits, 8) * max(page.samplesperpixel, len(all_bits)),
            orientation(page),
            len(pages),
            lossy=page.compression in _JPEG,
        )
        require_bounded(container, len(content))
        pieces = [content[start : start + size] for start, size in zip(*places.values(), strict=True)]
        if page.compression in _DEFLATE:
            _require_inflatable(
                pieces, 2 * container.width_px * container.height_px * container.pixel_bits // 8 + 2**20
            )
        return replace(container, content=_single_page(content, page, list(places), pieces))


def _require_pages_of_imagej(page: "TiffPage", pages: int) -> None:
    """Raise an error for a large stack of ImageJ, in which only the first page has a directory."""
    found = _IMAGEJ.match(page.description)
    if found is not None and int(found[1]) > pages:
        raise Damage(
            f"a stack of ImageJ with {int(found[1])} images and directories for {pages}",
            "save its images one by one, by ImageJ's Image Sequence",
        )


def _places(page: "TiffPage", file_bytes: int) -> dict[int, Sequence[int]]:
    """Return the positions and the sizes of the strips or tiles, in bytes, by their tags."""
    for tags in _STRIPS_AND_TILES:
        places, sizes = (page.tags.valueof(tag, default=()) for tag in tags)
        if not places or not sizes:
            continue
        total = sum(sizes)
        if any(start + size > file_bytes for start, size in zip(places, sizes, strict=False)):
            raise Damage(f"a TIFF that was cut off after {file_bytes} bytes")
        # Strips that share their bytes would make a small file fill the memory.
        if total > file_bytes:
            raise Damage(f"a TIFF whose strips overlap: {total} bytes in a file of {file_bytes} bytes")
        if total > MOST_IMAGE_BYTES:
            raise Damage(f"a page of {total / 2**20:.0f} MB, more than {MOST_IMAGE_BYTES // 2**20} MB")
        return {tags[0]: places[: len(sizes)], tags[1]: sizes[: len(places)]}
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


def _single_page(
    content: FileContent, page: "TiffPage", tags_of_places: Sequence[int], pieces: Sequence[bytes]
) -> bytes:
    """Return a TIFF file of this page: its pixels first, then the tags that describe them."""
    order = page.parent.byteorder
    sizes = [len(piece) for piece in pieces]
    *places, end = accumulate(sizes, initial=8)
    kept = {
        tag.code: (tag.dtype, tag.count, content[tag.valueoffset : tag.valueoffset + tag.valuebytecount])
        for tag in page.tags
        if tag.code in _OF_PIXELS
    }
    for code, numbers in zip(tags_of_places, (places, sizes), strict=True):
        kept[code] = (_LONG, len(numbers), struct.pack(f"{order}{len(numbers)}I", *numbers))
    values, directory = bytearray(end % 2), struct.pack(order + "H", len(kept))
    for code, (kind, number, stored) in sorted(kept.items()):
        if kind == _LONG8:
            # Only BigTIFF has numbers of 64 bit.
            kind = _LONG
            stored = struct.pack(f"{order}{number}I", *struct.unpack(f"{order}{number}Q", stored))
        directory += struct.pack(order + "HHI", code, kind, number)
        if len(stored) > 4:
            directory += struct.pack(order + "I", end + len(values))
            values += stored + bytes(len(stored) % 2)
        else:
            directory += stored.ljust(4, b"\0")
    header = struct.pack(order + "2sHI", b"II" if order == "<" else b"MM", 42, end + len(values))
    # The pixels may be hundreds of megabytes, so they are copied only once.
    return b"".join([header, *pieces, values, directory, bytes(4)])
