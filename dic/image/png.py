"""Check PNG files before they are decoded: chunks, checksums and declared size (ISO/IEC 15948)."""

import struct
import zlib

from dic.image.container import Container, Damage, inflated_bytes, require_bounded
from dic.image.tiff import orientation

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_NEEDED = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
"""PNG chunks that the decoder needs for the pixels.

Other chunks are removed, because the decoder's library libpng prints messages about mistakes in them.
"""


def read_png(content: bytes) -> Container:
    """Check a PNG file and read its header.

    Raises
    ------
    Damage
        If a chunk has a wrong checksum, if the file was cut off, if the compressed pixels are damaged, or if
        the declared image is far too large.
    struct.error
        If the file was cut off within a chunk.
    """
    chunks = _chunks(content)
    if not chunks or chunks[0][0] != b"IHDR":
        raise Damage("a PNG without a header")
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[0][1])
    if colour not in _CHANNELS:
        raise Damage(f"a PNG of colour type {colour}")
    exif = [data for kind, data, _ in chunks if kind == b"eXIf"]
    kept = Container(
        SIGNATURE + b"".join(whole for kind, _, whole in chunks if kind in _NEEDED),
        width,
        height,
        max(depth, 8) * _CHANNELS[colour],
        orientation(exif[0]) if exif else 1,
    )
    require_bounded(kept, len(content))
    stored_bits = depth * (1 if colour == 3 else _CHANNELS[colour])
    # For an interlaced image, this number is a lower limit. It leaves out the filter bytes and the padding of
    # the seven passes.
    needed = height * ((width * stored_bits + 7) // 8 + 1) if not interlaced else height * width // 8
    try:
        if inflated_bytes((data for kind, data, _ in chunks if kind == b"IDAT"), needed) < needed:
            raise Damage("a PNG with too few pixels")
    except zlib.error as error:
        raise Damage("a PNG with damaged pixels") from error
    return kept


def _chunks(content: bytes) -> list[tuple[bytes, bytes, bytes]]:
    """Return the type, the data and all bytes of each PNG chunk, up to the end chunk of the image."""
    chunks, position = [], len(SIGNATURE)
    while position < len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        end = position + 8 + length
        (checksum,) = struct.unpack_from(">I", content, end)
        if zlib.crc32(content[position + 4 : end]) != checksum:
            raise Damage(f"a PNG that is damaged at byte {position}")
        chunks.append((kind, content[position + 8 : end], content[position : end + 4]))
        if kind == b"IEND":
            return chunks
        position = end + 4
    raise Damage(f"a PNG that was cut off after {len(content)} bytes")
