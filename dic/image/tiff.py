"""Read the directories of TIFF and BigTIFF files with tifffile, within bounds (TIFF 6.0)."""

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from io import SEEK_CUR, SEEK_END, RawIOBase
from typing import TYPE_CHECKING

from dic.files.reading import Content, FileContent
from dic.image.container import Damage

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage

SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_SMALLER_OR_MASK = 0b101
"""Bits of the tag NewSubfileType that mark a page as a smaller copy or as a mask of another page."""
_READINGS, _LEAST_BYTES, _MOST_BYTES = 4, 2**20, 2**28
"""How much of a file tifffile may read: a multiple of its size, between these numbers of bytes."""

# tifffile reports damage to its log, which Python would print.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


@contextmanager
def opened_tiff(content: Content) -> Iterator["TiffFile"]:
    """Provide a TIFF file or Exif block whose first directory tifffile has read.

    Raises
    ------
    Damage
        Here or within the `with` block, if the file is damaged or was cut off.
    """
    from tifffile import TiffFile

    try:
        # tifffile would read further pages of files that it takes for those of certain microscopes.
        with TiffFile(_Bounded(content), is_lsm=False, is_scanimage=False, is_ndpi=False) as opened:  # type: ignore[arg-type]
            yield opened
    except (Damage, OSError):
        raise
    except Exception as error:
        # tifffile raises errors of many kinds for damaged files.
        raise Damage(f"a file that was cut off after {len(content)} bytes") from error


@contextmanager
def opened_page(content: Content, at: int | None = None) -> Iterator["TiffPage"]:
    """Provide the tags of the directory at a position, or of the first one; see `opened_tiff`."""
    from tifffile import TiffPage

    with opened_tiff(content) as tiff:
        if at is None:
            yield tiff.pages.first
        else:
            tiff.filehandle.seek(at)
            yield TiffPage(tiff, 0)


def pages_of_file(content: FileContent) -> list[int]:
    """Return the result of `page_directories`, which is computed once per file.

    A series reads the pages of a stack one by one, and each search follows the chain of all directories. If
    every page needed a search, the time of a series would grow with the square of its number of images.
    """
    found = _of_files(content.identity)
    if not found:
        # Two threads may do this at the same time.
        found[:] = page_directories(content)
    return found


@lru_cache(maxsize=8)
def _of_files(identity: tuple[int, ...]) -> list[int]:
    return []


def page_directories(content: Content) -> list[int]:
    """Return the positions of the directories of all pages, without smaller copies and masks of pages."""
    from tifffile import TiffPage

    pages: dict[int, bool] = {}
    with opened_tiff(content) as tiff:
        at = _unpack(tiff.tiff.offsetformat, content, 8 if tiff.is_bigtiff else 4)
        while at and at not in pages:
            pages[at] = True
            tiff.filehandle.seek(at)
            try:
                page = TiffPage(tiff, 0)
                at = _unpack(tiff.tiff.offsetformat, content, stored_tags(content, page)[1])
            except Exception:
                # The file ends before the end of the chain. The reader of this page tells of it.
                break
            pages[page.offset] = not page.subfiletype & _SMALLER_OR_MASK
    # If the tags mark every page as a copy or a mask, the tags are wrong. Then return all pages.
    return [place for place, whole in pages.items() if whole] or list(pages)


def stored_tags(content: Content, page: "TiffPage") -> tuple[set[int], int]:
    """Return all tags of a page, even those that tifffile left out, and the position behind its entries."""
    layout = page.parent.tiff
    first = page.offset + layout.tagnosize
    end = first + layout.tagsize * _unpack(layout.tagnoformat, content, page.offset)
    return {tag for tag, *_ in struct.iter_unpack(layout.tagheaderformat, content[first:end])}, end


def _unpack(code: str, content: Content, at: int) -> int:
    return int(struct.unpack(code, content[at : at + struct.calcsize(code)])[0])


def orientation(page: "TiffPage") -> int:
    """Return the orientation tag of a page or Exif block, 1 to 8, or 1 without a valid tag."""
    found = page.tags.valueof(274)
    return int(found) if found in range(1, 9) else 1


class _Bounded(RawIOBase):
    """The content of a file that can be read only a few times over.

    tifffile follows a circle of directories without an end: a file of 4 kB keeps it busy for ever. It also
    keeps the values of all entries, even of those that share their bytes: a file of 1 MB can take 6 GB.
    """

    def __init__(self, content: Content) -> None:
        self._content, self._at = content, 0
        self._left = min(_READINGS * len(content) + _LEAST_BYTES, _MOST_BYTES)

    def read(self, size: int = -1) -> bytes:
        data = self._content[self._at : len(self._content) if size < 0 else self._at + size]
        self._at += len(data)
        self._left -= len(data)
        if self._left < 0:
            raise Damage("a TIFF whose tags overlap")
        return data

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = offset + {SEEK_CUR: self._at, SEEK_END: len(self._content)}.get(whence, 0)
        return self._at

    def tell(self) -> int:
        return self._at
