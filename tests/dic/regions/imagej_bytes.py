"""Files of ImageJ's areas, byte by byte after the layout in ImageJ's decoder (`ij/io/RoiDecoder`)."""

import struct

POLYGON, RECT, OVAL, LINE, FREEHAND, TRACED, POINT = 0, 1, 2, 3, 7, 8, 10
SPLINE_FIT, SUB_PIXEL = 1, 128


def roi_bytes(
    kind: int,
    box: tuple[int, int, int, int],
    corners: list[tuple[int, int]] | None = None,
    *,
    exact: list[tuple[float, float]] | None = None,
    options: int = 0,
    subtype: int = 0,
    arc: int = 0,
) -> bytes:
    """Return a .roi file: a header of 64 bytes, whole coordinates from the box's corner, and exact ones.

    `box` is top, left, bottom, right. All numbers are big-endian.
    """
    corners = corners or []
    header = struct.pack(">4shBxhhhhH", b"Iout", 227, kind, *box, len(corners))
    header += bytes(16)
    header += struct.pack(">hi4s4shhBBhii", 0, 0, bytes(4), bytes(4), subtype, options, 0, 0, arc, 0, 0)
    assert len(header) == 64
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    content = header + struct.pack(f">{2 * len(corners)}h", *xs, *ys)
    if exact:
        content += struct.pack(f">{2 * len(exact)}f", *(x for x, _ in exact), *(y for _, y in exact))
    return content
