"""Is an image file complete and undamaged?

Decoders fill missing pixels with grey, often without an error, and correlation would measure a strain there.
So the containers of PNG, TIFF and BMP are checked before they are decoded.
"""

import struct
import zlib

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_TIFF_INTEGERS = {1: "B", 3: "H", 4: "I", 16: "Q"}
_STRIPS_AND_TILES = ((273, 279), (324, 325))
_COMPRESSION = 259
_DEFLATE = (8, 32946)
_WANTED_TAGS = {_COMPRESSION, *(tag for pair in _STRIPS_AND_TILES for tag in pair)}


def damage_in(content: bytes) -> str | None:
    """Return what is wrong with a PNG, TIFF or BMP file, or None if it is complete and undamaged.

    Parameters
    ----------
    content : bytes
        The whole file.

    Returns
    -------
    str or None
        A phrase that follows "got" in an error, such as ``"a PNG that was cut off after 5000 bytes"``.

    Notes
    -----
    PNG: the chunks, their checksums and the end chunk (ISO/IEC 15948, clause 5). TIFF and BigTIFF: every
    strip or tile of the first page lies within the file (TIFF 6.0, section 3), and the checksums of deflated
    ones are right. BMP: the size in the header.
    """
    if not content:
        return "an empty file"
    try:
        if content.startswith(_PNG_SIGNATURE):
            return _png_damage(content)
        if content[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return _tiff_damage(content)
        if content.startswith(b"BM"):
            return _bmp_damage(content)
    except struct.error:
        return f"a file that was cut off after {len(content)} bytes"
    return "another kind of file"


def _png_damage(content: bytes) -> str | None:
    position = len(_PNG_SIGNATURE)
    while position < len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        end = position + 8 + length
        (checksum,) = struct.unpack_from(">I", content, end)
        if zlib.crc32(content[position + 4 : end]) != checksum:
            return f"a PNG that is damaged at byte {position}"
        if kind == b"IEND":
            return None
        position = end + 4
    return f"a PNG that was cut off after {len(content)} bytes"


def _tiff_damage(content: bytes) -> str | None:
    tags = _tiff_tags(content)
    for offsets, counts in _STRIPS_AND_TILES:
        pieces = list(zip(tags.get(offsets, ()), tags.get(counts, ()), strict=False))
        if any(start + size > len(content) for start, size in pieces):
            return f"a TIFF that was cut off after {len(content)} bytes"
        if pieces:
            deflated = tags.get(_COMPRESSION, (1,))[0] in _DEFLATE
            return (
                _deflate_damage([content[start : start + size] for start, size in pieces])
                if deflated
                else None
            )
    return "a TIFF without pixels"


def _tiff_tags(content: bytes) -> dict[int, tuple[int, ...]]:
    """Return the values of the first page's tags for the places and the compression of its pixels."""
    order = "<" if content[:1] == b"I" else ">"
    big = content[2:4] in (b"+\0", b"\0+")
    offset_code, count_code, entry_bytes = ("Q", "Q", 20) if big else ("I", "H", 12)
    value_bytes = struct.calcsize(order + offset_code)
    (directory,) = struct.unpack_from(order + offset_code, content, 8 if big else 4)
    (entries,) = struct.unpack_from(order + count_code, content, directory)
    first = directory + struct.calcsize(order + count_code)
    tags = {}
    for at in range(first, first + entries * entry_bytes, entry_bytes):
        tag, kind, count = struct.unpack_from(order + "HH" + offset_code, content, at)
        if tag in _WANTED_TAGS and kind in _TIFF_INTEGERS:
            code = f"{order}{count}{_TIFF_INTEGERS[kind]}"
            inline = at + entry_bytes - value_bytes
            fits = struct.calcsize(code) <= value_bytes
            where = inline if fits else struct.unpack_from(order + offset_code, content, inline)[0]
            tags[tag] = struct.unpack_from(code, content, where)
    return tags


def _deflate_damage(pieces: list[bytes]) -> str | None:
    """Check the checksum at the end of each deflated strip or tile, which decoders do not."""
    try:
        for piece in pieces:
            zlib.decompress(piece)
    except zlib.error:
        return "a TIFF with damaged pixels"
    return None


def _bmp_damage(content: bytes) -> str | None:
    _, pixels, header, width, height, _, bits, compression = struct.unpack_from("<IxxxxIIiiHHI", content, 2)
    row_bytes = (abs(width) * bits + 31) // 32 * 4
    uncompressed = header >= 40 and compression in (0, 3)
    needed = pixels + row_bytes * abs(height) if uncompressed else struct.unpack_from("<I", content, 2)[0]
    return f"a BMP that was cut off after {len(content)} bytes" if len(content) < needed else None
