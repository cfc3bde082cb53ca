"""Read from Exif tags in TIFF, JPEG and PNG files when an image was taken (CIPA DC-008, Exif 2.32)."""

import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path

from dic.files.reading import Content, FileContent, opened
from dic.image.container import Damage
from dic.image.jpeg import SIGNATURE as JPEG
from dic.image.png import SIGNATURE as PNG
from dic.image.tiff_directory import (
    SIGNATURES,
    byte_order,
    first_directory,
    integers,
    pages_of_file,
    read_entries,
)

_EXIF_DIRECTORY, _TAKEN, _FRACTION, _OFFSET = 34665, 36867, 37521, 36881
_APP1, _START_OF_SCAN = 0xE1, 0xDA
_MOST_BYTES = 1 << 20
"""Largest size of an Exif block that is read; a block without preview images has some kilobytes."""


def taken_s(file: Path, page: int = 1) -> float | None:
    """Return when an image was taken, s; None if its file does not say so.

    The time counts from a fixed moment. The tag DateTimeOriginal gives whole seconds, and the tag
    SubSecTimeOriginal gives the fraction of a second. Without the tag OffsetTimeOriginal, the time zone is
    not known. The differences between images are then right only if nobody has set the camera's clock to
    another time zone between the images.

    Parameters
    ----------
    file : Path
    page : int
        Page of a TIFF file, from 1.
    """
    try:
        with opened(file) as content:
            block, at = _block(content, page)
            return None if block is None else _taken_s(block, at)
    except (OSError, struct.error, Damage, ValueError):
        # A damaged file gives no time here. The reader of the image raises the error that names the damage.
        return None


def _block(content: FileContent, page: int) -> tuple[Content | None, int]:
    """Return the Exif block of a file, and the position of its first directory."""
    if content[:4] in SIGNATURES:
        return content, pages_of_file(content)[min(page, len(pages_of_file(content))) - 1]
    block = None
    if content[:3] == JPEG:
        block = _of_jpeg(content)
    elif content[:8] == PNG:
        block = _of_png(content)
    return (None, 0) if block is None else (block, first_directory(block))


def _of_jpeg(content: FileContent) -> bytes | None:
    at = 2
    while at < len(content):
        begin, marker, length = struct.unpack(">BBH", content[at : at + 4])
        if begin != 0xFF:
            return None
        data = content[at + 4 : at + 2 + length] if marker == _APP1 else b""
        if data.startswith(b"Exif\0\0"):
            return data[6:]
        if marker == _START_OF_SCAN:
            return None
        at += 2 + length
    return None


def _of_png(content: FileContent) -> bytes | None:
    at = len(PNG)
    while at < len(content):
        length, kind = struct.unpack(">I4s", content[at : at + 8])
        if kind == b"eXIf" and length <= _MOST_BYTES:
            return content[at + 8 : at + 8 + length]
        # Behind the end of the image, and in a damaged file, are no further blocks.
        if kind == b"IEND" or not kind.isalpha():
            return None
        at += 12 + length
    return None


def _taken_s(block: Content, at: int) -> float | None:
    place = integers(read_entries(block, at, (_EXIF_DIRECTORY,)), byte_order(block)).get(_EXIF_DIRECTORY)
    if place is None:
        return None
    entries = read_entries(block, place[0], (_TAKEN, _FRACTION, _OFFSET))
    texts = {entry.tag: entry.stored.split(b"\0")[0].decode("ascii").strip() for entry in entries}
    if not texts.get(_TAKEN):
        return None
    taken = datetime.strptime(texts[_TAKEN], "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    fraction = texts.get(_FRACTION, "")
    offset = texts.get(_OFFSET, "")
    zone = timedelta()
    if offset:
        hours, minutes = offset[1:].split(":")
        zone = timedelta(hours=int(hours), minutes=int(minutes)) * (-1 if offset[0] == "-" else 1)
    return (taken - zone).timestamp() + (float(f"0.{fraction}") if fraction.isdecimal() else 0.0)
