"""Check PNG, JPEG, PGM, PPM and BMP files before they are decoded: they must be complete, and not too large.

Sources: ISO/IEC 15948 (PNG), ITU-T T.81, annex B (JPEG), the formats P2, P3, P5 and P6 of Netpbm.
"""

import re
import struct
import zlib
from collections.abc import Callable, Iterator

from dic.files.reading import Content
from dic.image.container import Container, Damage, require_bounded
from dic.image.tiff import opened_page, orientation

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_NEEDED = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
"""PNG chunks that the decoder needs for the pixels.

Other chunks are removed, because the decoder's library libpng prints messages about mistakes in them.
"""
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_APP1, _START_OF_SCAN, _END = 0xE1, 0xDA, b"\xff\xd9"
_MOST_EXIF_BYTES = 2**20
"""Largest size of an Exif block that is read; a block without preview images has some kilobytes."""
_SPACE = rb"(?:\s|#[^\n]*\n)"
_NETPBM = re.compile(rb"P[2356]" + 3 * (_SPACE + rb"+(\d{1,10})") + _SPACE)


def read_header(content: bytes) -> Container:
    """Check an image file that is no TIFF file, and read its header.

    Raises `Damage` if the file is damaged, was cut off or is no image, or if the declared image is far too
    large.
    """
    if not content:
        raise Damage("an empty file")
    try:
        for signature, read in _READERS.items():
            if content.startswith(signature):
                return read(content)
    except struct.error as error:
        raise Damage(f"a file that was cut off after {len(content)} bytes") from error
    raise Damage("another kind of file")


def exif_block(content: Content) -> bytes | None:
    """Return the Exif block of a PNG or JPEG file, None if it has none.

    Raises `Damage` or `struct.error` if the file is damaged or was cut off before its Exif block.
    """
    if content[: len(_PNG)] == _PNG:
        blocks = (
            content[at : at + size]
            for kind, at, size in _chunks(content)
            if kind == b"eXIf" and size <= _MOST_EXIF_BYTES
        )
        return next(blocks, None)
    if content[: len(_JPEG)] != _JPEG:
        return None
    segments = (
        data[6:] for marker, data, _ in _segments(content) if marker == _APP1 and data[:6] == b"Exif\0\0"
    )
    return next(segments, None)


def _turned(content: bytes) -> int:
    block = exif_block(content)
    if block is None:
        return 1
    try:
        with opened_page(block) as page:
            return orientation(page)
    except Damage:
        return 1


def _chunks(content: Content) -> Iterator[tuple[bytes, int, int]]:
    """Yield the type of each PNG chunk, and the position and size of its data, up to the end of the image."""
    at, kind = len(_PNG), b""
    while kind != b"IEND":
        if at >= len(content):
            raise Damage(f"a PNG that was cut off after {len(content)} bytes")
        size, kind = struct.unpack(">I4s", content[at : at + 8])
        if not kind.isalpha():
            raise Damage(f"a PNG that is damaged at byte {at}")
        yield kind, at + 8, size
        at += size + 12


def _segments(content: Content) -> Iterator[tuple[int, bytes, int]]:
    """Yield the marker, the data and the end of each JPEG segment, up to the first coded pixels."""
    at, marker = 2, 0
    while marker != _START_OF_SCAN:
        while content[at : at + 2] == b"\xff\xff":
            at += 1  # fill bytes may precede a marker
        prefix, marker, size = struct.unpack(">BBH", content[at : at + 4])
        if prefix != 0xFF:
            raise Damage(f"a JPEG that is damaged at byte {at}")
        data = content[at + 4 : at + 2 + size]
        at += 2 + size
        if len(data) != size - 2:
            raise Damage(f"a JPEG that was cut off after {len(content)} bytes")
        yield marker, data, at


def _read_png(content: bytes) -> Container:
    kept, turned = [_PNG], 1
    for kind, at, size in _chunks(content):
        (checksum,) = struct.unpack_from(">I", content, at + size)
        if zlib.crc32(content[at - 4 : at + size]) != checksum:
            raise Damage(f"a PNG that is damaged at byte {at - 8}")
        if kind in _NEEDED:
            kept.append(content[at - 8 : at + size + 4])
        if kind == b"eXIf":
            turned = _turned(content)
    if kept[1][4:8] != b"IHDR":
        raise Damage("a PNG without a header")
    width, height, depth, colour = struct.unpack(">8xIIBB7x", kept[1])
    if colour not in _CHANNELS:
        raise Damage(f"a PNG of colour type {colour}")
    container = Container(b"".join(kept), width, height, max(depth, 8) * _CHANNELS[colour], turned)
    require_bounded(container, len(content))
    return container


def _read_jpeg(content: bytes) -> Container:
    size, end = None, 0
    for marker, data, at in _segments(content):
        end = at
        if marker in _FRAMES:
            bits, height, width, channels = struct.unpack_from(">BHHB", data)
            size = width, height, bits * channels
    if size is None:
        raise Damage("a JPEG without a header")
    # In coded pixels, no byte 0xFF stands before 0xD9.
    if content.find(_END, end) < 0:
        raise Damage(f"a JPEG that was cut off after {len(content)} bytes")
    container = Container(content, *size, _turned(content), lossy=True)
    require_bounded(container, len(content))
    return container


def _read_netpbm(content: bytes) -> Container:
    header = _NETPBM.match(content)
    if header is None:
        raise Damage("a PGM or PPM without a header")
    width, height, brightest = (int(number) for number in header.groups())
    if not 0 < brightest <= 65535:
        raise Damage(f"a PGM or PPM with grey levels up to {brightest}")
    as_text, channels = content[1:2] in b"23", 3 if content[1:2] in b"36" else 1
    values, value_bytes = width * height * channels, 2 if brightest > 255 else 1
    kept = content
    if as_text:
        # The decoder scales 8-bit levels of a text file so that the declared highest level becomes 255, and
        # fails if the file ends directly after the last number.
        highest = b"255" if value_bytes == 1 else header[3]
        kept = content[: header.start(3)] + highest + content[header.end(3) :] + b"\n"
    container = Container(kept, width, height, 8 * value_bytes * channels)
    require_bounded(container, len(content))
    # In a text file, each value needs at least one digit, and a space separates neighbouring values.
    needed = 2 * values - 1 if as_text else values * value_bytes
    if len(content) - header.end() < needed:
        raise Damage(f"a PGM or PPM that was cut off after {len(content)} bytes")
    return container


def _read_bmp(content: bytes) -> Container:
    _, pixels, header, width, height, _, bits, compression = struct.unpack_from("<IxxxxIIiiHHI", content, 2)
    row_bytes = (abs(width) * bits + 31) // 32 * 4
    uncompressed = header >= 40 and compression in (0, 3)
    needed = pixels + row_bytes * abs(height) if uncompressed else struct.unpack_from("<I", content, 2)[0]
    if len(content) < needed:
        raise Damage(f"a BMP that was cut off after {len(content)} bytes")
    # OpenCV decodes at least 8 bits per channel, and decodes an image with a palette to three channels.
    container = Container(content, abs(width), abs(height), max(bits, 24))
    require_bounded(container, len(content))
    return container


_READERS: dict[bytes, Callable[[bytes], Container]] = {
    _PNG: _read_png,
    _JPEG: _read_jpeg,
    **dict.fromkeys((b"P2", b"P3", b"P5", b"P6"), _read_netpbm),
    b"BM": _read_bmp,
}
