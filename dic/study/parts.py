"""Chooses representative parts of the region, on which a study tries the settings."""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Indices, Mask

PART_PX = 448
"""Width and height of a part of a large region."""

_SMALL_PX2 = 2 * PART_PX**2
"""If the rectangle around the region has at most this area, the whole region is one part."""
_LEAST_SHARE = 0.5
"""A further part is used only if at least this share of its area is region outside the other parts."""
_AS_GOOD = 0.98
"""A place counts as equally good as the best one if its share of region is at least this fraction."""


@dataclass(frozen=True)
class ImagePart:
    """A rectangle of the image."""

    top: int
    left: int
    height: int
    width: int
    """Upper left corner and size of the rectangle, px."""

    @property
    def pixels(self) -> tuple[slice, slice]:
        """The part as an index of an image."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)


def chosen_parts(region: Mask, parts: int) -> tuple[ImagePart, ...]:
    """Return parts of a region that lie far from one another.

    A small region is one part. In a large region, the first part lies near the middle of the region. Each
    further part must contain much region that no earlier part contains. Among the possible places, the place
    farthest from all earlier parts is chosen.

    `parts`: largest number of parts. `region` has the shape (height, width).
    """
    import cv2

    left, top, width, height = cv2.boundingRect(region.view(np.uint8))
    whole = ImagePart(top, left, height, width)
    if width * height <= _SMALL_PX2:
        return (whole,)
    size = min(PART_PX, height), min(PART_PX, width)
    places = _places(whole, size)
    rows, columns = np.nonzero(region)
    centres = places + np.array(size) / 2
    far = -np.hypot(*(centres - [rows.mean(), columns.mean()]).T)
    free, chosen = region.copy(), list[ImagePart]()
    for _ in range(parts):
        shares = _shares(free, places, size)
        if chosen and shares.max() < _LEAST_SHARE:
            break
        good = np.flatnonzero(shares >= _AS_GOOD * shares.max())
        best = good[np.argmax(far[good])]
        chosen.append(ImagePart(int(places[best, 0]), int(places[best, 1]), *size))
        free[chosen[-1].pixels] = False
        nearest = np.hypot(*(centres - centres[best]).T)
        far = nearest if len(chosen) == 1 else np.minimum(far, nearest)
    return tuple(chosen)


def _places(whole: ImagePart, size: tuple[int, int]) -> Indices:
    """Return the upper left corners (row, column) of all places that are tried for a part, shape (n, 2)."""
    starts = []
    for first, length, own in ((whole.top, whole.height, size[0]), (whole.left, whole.width, size[1])):
        spare = length - own
        count = 1 + int(np.ceil(spare / (PART_PX / 4)))
        starts.append(first + np.rint(np.linspace(0, spare, count)).astype(np.int64))
    return np.stack(np.meshgrid(*starts, indexing="ij"), axis=-1).reshape(-1, 2)


def _shares(free: Mask, places: Indices, size: tuple[int, int]) -> Float:
    sums = np.pad(np.cumsum(np.cumsum(free, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    (top, left), (bottom, right) = places.T, (places + size).T
    inside = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return np.asarray(inside / (size[0] * size[1]))
