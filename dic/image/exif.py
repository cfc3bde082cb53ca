"""Read from Exif tags in TIFF, JPEG and PNG files when an image was taken (CIPA DC-008, Exif 2.32)."""

import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path

from dic.files.reading import Content, opened
from dic.image.container import Damage
from dic.image.headers import exif_block
from dic.image.tiff import SIGNATURES, opened_page, pages_of_file

_EXIF_DIRECTORY = 34665


def taken_s(file: Path, page: int = 1) -> float | None:
    """Return when an image was taken, s; None if its file does not say so.

    The time counts from a fixed moment. The tag DateTimeOriginal gives whole seconds, and the tag
    SubSecTimeOriginal gives the fraction of a second. Without the tag OffsetTimeOriginal, the time zone is
    not known. The differences between images are then right only if nobody has set the camera's clock to
    another time zone between the images.

    `page`: page of a TIFF file, from 1.
    """
    try:
        with opened(file) as content:
            if content[:4] in SIGNATURES:
                pages = pages_of_file(content)
                return _of_directory(content, pages[min(page, len(pages)) - 1])
            block = exif_block(content)
            return None if block is None else _of_directory(block)
    except (OSError, Damage, IndexError, ValueError, struct.error):
        # A damaged file gives no time here. The reader of the image raises the error that names the damage.
        return None


def _of_directory(content: Content, at: int | None = None) -> float | None:
    with opened_page(content, at) as page:
        tags = page.tags.valueof(_EXIF_DIRECTORY)
    # Of a damaged directory, tifffile gives the position.
    if not isinstance(tags, dict) or not tags.get("DateTimeOriginal"):
        return None
    taken = datetime.strptime(tags["DateTimeOriginal"], "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    fraction, offset = tags.get("SubsecTimeOriginal", ""), tags.get("OffsetTimeOriginal", "")
    zone = timedelta()
    if offset:
        hours, minutes = offset[1:].split(":")
        zone = timedelta(hours=int(hours), minutes=int(minutes)) * (-1 if offset[0] == "-" else 1)
    return (taken - zone).timestamp() + (float(f"0.{fraction}") if fraction.isdecimal() else 0.0)
