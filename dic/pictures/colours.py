"""The colours of maps, as tables of 256 colours."""

import numpy as np
from numpy.typing import NDArray

_RED_TO_BLUE = (
    (103, 0, 31), (178, 24, 43), (214, 96, 77), (244, 165, 130), (253, 219, 199), (247, 247, 247),
    (209, 229, 240), (146, 197, 222), (67, 147, 195), (33, 102, 172), (5, 48, 97),
)  # fmt: skip
"""ColorBrewer's RdBu of eleven classes (Brewer and Harrower, colorbrewer2.org)."""


def colour_table(name: str) -> NDArray[np.uint8]:
    """Return red, green and blue of a colour map from its lower to its upper end, shape (256, 3).

    `name`: one of `dic.pictures.settings.COLOURS`.
    """
    import cv2

    levels = np.arange(256, dtype=np.uint8)
    if name == "grey":
        return np.repeat(levels[:, None], 3, axis=1)
    if name == "diverging":
        classes = np.array(_RED_TO_BLUE[::-1], np.float64)
        places = np.linspace(0.0, 1.0, len(classes))
        channels = [np.interp(levels / 255.0, places, channel) for channel in classes.T]
        return np.round(np.stack(channels, axis=1)).astype(np.uint8)
    known = {
        "viridis": cv2.COLORMAP_VIRIDIS,
        "cividis": cv2.COLORMAP_CIVIDIS,
        "inferno": cv2.COLORMAP_INFERNO,
    }
    table = cv2.applyColorMap(levels[:, None], known[name])
    return np.ascontiguousarray(table[:, 0, ::-1])


def blended(table: NDArray[np.uint8], opacity: float, under: float) -> NDArray[np.uint8]:
    """Return colours (n, 3) over a grey level from 0 to 1."""
    return np.round(opacity * table + 255.0 * (1.0 - opacity) * under).astype(np.uint8)
