"""Check JPEG files before they are decoded: segments and declared size (ITU-T T.81, annex B)."""

import struct
from collections.abc import Iterator

from dic.image.container import Container, Damage, require_bounded
from dic.image.tiff import orientation

SIGNATURE = b"\xff\xd8\xff"
_START_OF_SCAN, _END = 0xDA, 0xD9
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_EXIF = 0xE1
_LEFT_OUT = {*range(0xE1, 0xF0), 0xFE} - {0xEE}
"""Segments that the decoder does not need. APP0 and APP14 are needed, because they name the colours."""


def read_jpeg(content: bytes) -> Container:
    """Check a JPEG file and read its header.

    Raises
    ------
    Damage
        If a segment is damaged or missing, if the file was cut off, or if the image is far too large.
    struct.error
        If the file was cut off within a segment.
    """
    kept, size, turned = bytearray(SIGNATURE[:2]), None, 1
    for marker, data, whole in _segments(content):
        if marker in _FRAMES:
            bits, height, width, channels = struct.unpack_from(">BHHB", data)
            size = width, height, bits * channels
        if marker == _EXIF and data.startswith(b"Exif\0\0"):
            turned = orientation(data[6:])
        if marker not in _LEFT_OUT:
            kept += whole
    if size is None:
        raise Damage("a JPEG without a header")
    container = Container(bytes(kept), *size, orientation=turned, lossy=True)
    require_bounded(container, len(content))
    return container


def _segments(content: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield the marker, the data and all bytes of each segment; a scan's bytes include its coded pixels."""
    position = 2
    while True:
        start = position
        while content[position : position + 2] == b"\xff\xff":
            position += 1  # fill bytes may precede a marker
        prefix, marker = struct.unpack_from(">BB", content, position)
        if prefix != 0xFF:
            raise Damage(f"a JPEG that is damaged at byte {position}")
        position += 2
        if marker == _END:
            yield marker, b"", content[start:position]
            return
        (length,) = struct.unpack_from(">H", content, position)
        data = content[position + 2 : position + length]
        if length < 2 or len(data) != length - 2:
            raise Damage(f"a JPEG that was cut off after {len(content)} bytes")
        position += length
        if marker == _START_OF_SCAN:
            position = _end_of_scan(content, position)
        yield marker, data, content[start:position]


def _end_of_scan(content: bytes, position: int) -> int:
    """Return the position of the next marker after coded pixels.

    Within coded pixels, 0 or a value from 0xD0 to 0xD7 follows every byte 0xFF.
    """
    while (position := content.find(b"\xff", position)) >= 0 and position + 1 < len(content):
        following = content[position + 1]
        if following not in (0x00, 0xFF) and not 0xD0 <= following <= 0xD7:
            return position
        position += 1 if following == 0xFF else 2
    raise Damage(f"a JPEG that was cut off after {len(content)} bytes")
