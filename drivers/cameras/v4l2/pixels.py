"""Grey levels from a V4L2 buffer, at full bit depth and without row padding."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Grey:
    """Storage of grey levels in a pixel format.

    Attributes
    ----------
    code : str
        The format's four-character code.
    bits : int
        Number of significant bits; these are the lowest bits of the container.
    pixel_bytes : int
        From one pixel to the next.
    dtype : str
        Type of the container in memory.
    """

    code: str
    bits: int
    pixel_bytes: int
    dtype: str


FORMATS = {
    grey.code: grey
    for grey in (
        Grey("GREY", 8, 1, "u1"),
        Grey("Y10", 10, 2, "<u2"),
        Grey("Y12", 12, 2, "<u2"),
        Grey("Y16", 16, 2, "<u2"),
        Grey("YUYV", 8, 2, "u1"),  # alternating luma and chroma, luma first
    )
}


def bytes_needed(grey: Grey, width: int, height: int, stride: int) -> int:
    """Return how many bytes a whole image has; the last row may lack its padding."""
    return (height - 1) * stride + width * grey.pixel_bytes


def grey_levels(memory: memoryview, grey: Grey, width: int, height: int, stride: int) -> Image:
    """Copy the grey levels of one buffer.

    Parameters
    ----------
    memory : memoryview of bytes
        The part of the buffer that the camera has filled; missing rows become black.
    grey : Grey
    width, height : int
    stride : int
        Bytes from one row to the next.

    Returns
    -------
    ndarray of uint8 or uint16, shape (height, width)
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
    # always a copy: the buffer goes back to the camera
    return np.array(values, np.uint8) if grey.bits <= 8 else np.array(values, np.uint16)
