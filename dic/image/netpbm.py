"""Check PGM and PPM files before they are decoded (the formats P2, P3, P5 and P6 of Netpbm)."""

import re

from dic.image.container import Container, Damage, require_bounded

SIGNATURES = (b"P2", b"P3", b"P5", b"P6")
_SPACE = rb"(?:\s|#[^\n]*\n)"
_HEADER = re.compile(rb"P[2356]" + 3 * (_SPACE + rb"+(\d{1,10})") + _SPACE)
_BRIGHTEST = 65535


def read_netpbm(content: bytes) -> Container:
    """Check a PGM or PPM file and read its header.

    Raises
    ------
    Damage
        If the header is damaged, if the file was cut off, or if the declared image is far too large.
    """
    header = _HEADER.match(content)
    if header is None:
        raise Damage("a PGM or PPM without a header")
    width, height, brightest = (int(number) for number in header.groups()[:3])
    if not 0 < brightest <= _BRIGHTEST:
        raise Damage(f"a PGM or PPM with grey levels up to {brightest}")
    channels, value_bytes = 3 if content[1:2] in b"36" else 1, 2 if brightest > 255 else 1
    as_text, size = content[1:2] in b"23", len(content)
    if as_text:
        content = _as_decoded_unscaled(content, header, value_bytes)
    container = Container(content, width, height, 8 * channels * value_bytes)
    require_bounded(container, size)
    values = width * height * channels
    # In a text file, each value needs at least one digit, and a space separates neighbouring values.
    needed = 2 * values - 1 if as_text else values * value_bytes
    if size - header.end() < needed:
        raise Damage(f"a PGM or PPM that was cut off after {size} bytes")
    return container


def _as_decoded_unscaled(content: bytes, header: re.Match[bytes], value_bytes: int) -> bytes:
    """Return a text file that the decoder reads without scaling.

    The decoder scales the 8-bit levels of a text file so that the declared highest level becomes 255. The
    decoder also fails if the file ends directly after the last number.
    """
    first, last = header.span(3)
    brightest = b"255" if value_bytes == 1 else content[first:last]
    return content[:first] + brightest + content[last:] + b"\n"
