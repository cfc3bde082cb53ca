"""Check an image file before it is decoded: the file must be complete, and the image not too large.

Decoders fill missing pixels with grey, often without an error. Correlation would measure a wrong strain in
such grey areas. A file of a few kilobytes can also declare an image that fills the memory. So the structure
of PNG, TIFF and BMP files is checked first.
"""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

MOST_PIXELS = 160_000_000
"""Largest number of pixels of an image; the largest area sensors have 151 megapixels."""

MOST_DECODED_BYTES = 640 * 2**20
"""Largest size of a decoded image, which is enough for 160 megapixels of 32 bit."""

SMALL_BYTES = 64 * 2**20
MOST_COMPRESSION = 300
"""Largest compression factor of an image above `SMALL_BYTES`; more compressed images are refused.

An image with camera noise is compressed by a factor below 10. An image of zeros reaches a factor of 1032 with
the deflate method.
"""

_PIECE = 2**20


class Damage(Exception):
    """An image file cannot be used; damage and remedy become parts of an `ImageError`."""

    def __init__(self, damage: str, remedy: str = "save or copy it again") -> None:
        super().__init__(damage)
        self.remedy = remedy


@dataclass(frozen=True)
class Container:
    """An undamaged image file that has not been decoded yet."""

    content: bytes
    """The file's content for the decoder, without colour profiles and without the orientation tag. OpenCV 5.0
    applies the orientation tag wrongly to TIFF files, and ignores the orientation tag of PNG files.
    """
    width_px: int
    height_px: int
    """Width and height that the file declares."""
    pixel_bits: int
    """Number of bits of a pixel: the sum over its colour channels."""
    orientation: int = 1
    """The value of the orientation tag, 1 to 8. An image with the value 1 is upright (TIFF 6.0, section 8).
    """
    pages: int = 1
    """Number of pages in the file."""
    lossy: bool = False
    """True if the pixels are compressed with losses, as in a JPEG file."""


def require_bounded(container: Container, file_bytes: int) -> None:
    """Raise `Damage` if the declared image exceeds the largest size, or is far larger than its file."""
    width, height = container.width_px, container.height_px
    decoded_bytes = width * height * container.pixel_bits // 8
    shown = f"an image of {width} × {height} px"
    if width <= 0 or height <= 0:
        raise Damage(f"{shown}, which has no pixels")
    if width * height > MOST_PIXELS or decoded_bytes > MOST_DECODED_BYTES:
        raise Damage(f"{shown} and {container.pixel_bits} bits, more than {MOST_PIXELS // 10**6} megapixels")
    if decoded_bytes > max(SMALL_BYTES, MOST_COMPRESSION * file_bytes):
        raise Damage(f"{shown} in a file of {file_bytes / 1000:.0f} kB, which no camera's image fits in")


def inflated_bytes(pieces: Iterable[bytes], most_bytes: int) -> int:
    """Return the number of bytes that deflated data have after decompression.

    The decompressed bytes are only counted, not kept. Counting ends when the number exceeds `most_bytes`.
    Damaged or incomplete data raise `zlib.error`.
    """
    inflate, count = zlib.decompressobj(), 0
    for piece in pieces:
        waiting = piece
        while waiting and count <= most_bytes and not inflate.eof:
            count += len(inflate.decompress(waiting, _PIECE))
            waiting = inflate.unconsumed_tail
    while not inflate.eof and count <= most_bytes:
        rest = inflate.decompress(b"", _PIECE)
        if not rest:
            raise zlib.error("cut off")
        count += len(rest)
    return count
