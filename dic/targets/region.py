"""The region of an image that shows the target, and the error if the image shows two targets."""

import numpy as np

from dic.errors import CalibrationError
from dic.typing import Float, Grey

Region = tuple[float, float, float, float]
"""Left, top, width and height of a rectangle in an image, px."""

_SMALLEST_PX = 32


def cropped(grey: Grey, region_px: Region, source: str) -> tuple[Grey, tuple[int, int]]:
    """Return the part of an image in a region, and the position of its first pixel, (x, y).

    Raises `CalibrationError` if the region is smaller than 32 × 32 px or not within the image.
    """
    height, width = grey.shape
    left, top, across, down = region_px
    within = left >= 0 and top >= 0 and left + across <= width and top + down <= height
    if not (within and min(across, down) >= _SMALLEST_PX):
        raise CalibrationError(
            source,
            "find target",
            f"a region of at least {_SMALLEST_PX} × {_SMALLEST_PX} px within {width} × {height} px",
            f"left {left:g}, top {top:g}, width {across:g}, height {down:g}",
            f"give --region 0 0 {width} {height}, or a part of it",
        )
    first, last = (round(left), round(top)), (round(left + across), round(top + down))
    return grey[first[1] : last[1], first[0] : last[0]], first


def two_targets(source: str, kind: str, places: tuple[Float, Float]) -> CalibrationError:
    """Return the error for an image of two targets; `places` are their points (n, 2), px."""
    middles = " and ".join(f"x {x:.0f} y {y:.0f}" for x, y in (each.mean(axis=0) for each in places))
    low, high = places[0].min(axis=0), places[0].max(axis=0)
    margin = 0.1 * (high - low)
    low, size = np.floor(np.maximum(low - margin, 0)), np.ceil(high - low + 2 * margin)
    return CalibrationError(
        source,
        f"find {kind}",
        "one target in the image",
        f"two, around {middles} px",
        f"choose one by its region, such as --region {low[0]:.0f} {low[1]:.0f} {size[0]:.0f} {size[1]:.0f}",
    )
