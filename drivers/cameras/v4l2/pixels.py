"""Copy grey levels out of a V4L2 buffer, at full bit depth and without row padding."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Grey:
    """Description of how a pixel format stores grey levels."""

    code: str  # the format's four-character code
    bits: int  # number of significant bits per pixel, stored in the lowest bits of a `dtype` number
    pixel_bytes: int  # number of bytes from one pixel to the next
    dtype: str  # NumPy type of one grey level in the buffer


FORMATS = {
    grey.code: grey
    for grey in (
        Grey("GREY", 8, 1, "u1"),
        Grey("Y10", 10, 2, "<u2"),
        Grey("Y12", 12, 2, "<u2"),
        Grey("Y16", 16, 2, "<u2"),
        Grey("YUYV", 8, 2, "u1"),  # luma and chroma bytes alternate, luma first
    )
}


def bytes_needed(grey: Grey, width: int, height: int, stride: int) -> int:
    """Return the number of bytes of a complete image, not counting the padding of the last row."""
    return (height - 1) * stride + width * grey.pixel_bytes


def grey_levels(memory: memoryview, grey: Grey, width: int, height: int, stride: int) -> Image:
    """Copy the grey levels of one buffer.

    `memory` is the part of the buffer that the camera has filled. Missing rows become black in the image,
    whose shape is (height, width). `stride` is the number of bytes from the start of one row to the start of
    the next row.
    """
    filled = np.frombuffer(memory[: height * stride], np.uint8)
    if filled.size < height * stride:
        whole = np.zeros(height * stride, np.uint8)
        whole[: filled.size] = filled
    else:
        whole = filled
    rows = whole.reshape(height, stride)[:, : width * grey.pixel_bytes]
    values = rows.view(grey.dtype)
    if grey.pixel_bytes > values.itemsize:
        values = values[:, :: grey.pixel_bytes // values.itemsize]
    # always copy, because the camera will fill the buffer again
    return np.array(values, np.uint8) if grey.bits <= 8 else np.array(values, np.uint16)
