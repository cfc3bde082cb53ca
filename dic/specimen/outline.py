"""Draw the outline of the specimen along its outermost speckles and edges."""

import numpy as np

from dic.image.threads import bands_of
from dic.specimen.surfaces import Bits, Surfaces, square
from dic.specimen.texture import TextureMaps
from dic.typing import Mask

_EDGE = 0.2
"""A pixel belongs to a speckle's edge if its energy exceeds this fraction of the specimen's mean energy."""

_EDGE_ABOVE_NOISE = 8.0
"""An edge's energy must exceed this multiple of `noise`. White noise does so at 2 % of the pixels."""

_GAPS = 99.9
"""A gap wider than this percentile of the distances to the nearest edge is a hole."""

_NEAR = 0.28
"""The outline is at most this fraction of a window away from the windows that are half full of texture."""

_ROUND = 0.3
"""Parts narrower than this fraction of the specimen, such as a cable beside it, do not belong to it."""

_BAND_PX = 128
"""Height of the bands in which the mask is enlarged, in reduced pixels."""

_NO_SUBSET_PX = 4
"""No subset uses the outermost pixels of the image, so the image's dark border does not matter there."""


def edges_of_speckles(maps: TextureMaps, surfaces: Surfaces) -> Bits:
    """Return the pixels at the edges of the specimen's speckles, in reduced pixels."""
    import cv2

    near = cv2.dilate(surfaces.windows, _disc(max(2, round(_NEAR * maps.window))))
    edges = maps.energy > np.float32(_EDGE) * surfaces.energy
    edges &= maps.energy > np.float32(_EDGE_ABOVE_NOISE) * maps.noise
    return np.asarray(edges.view(np.uint8) & near, np.uint8)


def outline(edge: Bits, windows: Bits, inside: Bits, window: int) -> Bits:
    """Return the mask of the specimen, in reduced pixels.

    `edge`: the result of `edges_of_speckles`. `windows`, `inside`: as in `Surfaces`. `window`: width of the
    windows, in reduced pixels.
    """
    import cv2

    gap = _widest_gap(edge, inside, window)
    margin = 2 * window
    around = (margin,) * 4
    # The specimen continues beyond the image's edge, so close the gaps between speckles and this edge too.
    edge = cv2.copyMakeBorder(edge, *around, cv2.BORDER_CONSTANT, value=1)
    surrounded = np.asarray(cv2.copyMakeBorder(inside, *around, cv2.BORDER_REPLICATE), np.uint8)
    closed = cv2.morphologyEx(edge, cv2.MORPH_CLOSE, square(2 * gap + 1))[margin:-margin, margin:-margin]
    full = np.asarray(cv2.copyMakeBorder(closed, *around, cv2.BORDER_REPLICATE), np.uint8)
    whole = _without_holes(full)
    holes = cv2.morphologyEx(whole & (1 - full), cv2.MORPH_OPEN, _disc(gap))
    radius = _ROUND * float(cv2.distanceTransform(windows, cv2.DIST_L2, 3).max())
    smooth = _smoothed(whole, surrounded, int(np.clip(radius, 3, window)))
    return np.asarray(smooth & (1 - holes), np.uint8)[margin:-margin, margin:-margin]


def _widest_gap(edge: Bits, inside: Bits, window: int) -> int:
    """Return half the width of the widest usual gap between the edges of speckles, in reduced pixels."""
    import cv2

    distance = cv2.distanceTransform(1 - edge, cv2.DIST_C, 3)
    return min(max(2, int(np.ceil(1.2 * np.percentile(distance[inside > 0], _GAPS)))), window)


def _without_holes(mask: Bits) -> Bits:
    import cv2

    outside = cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    cv2.floodFill(outside, None, (0, 0), 2)
    return np.asarray(outside[1:-1, 1:-1] != 2).view(np.uint8)


def _smoothed(whole: Bits, inside: Bits, radius: int) -> Bits:
    """Return the mask without narrow parts, and without parts that lie outside the specimen."""
    import cv2

    wide = cv2.morphologyEx(whole, cv2.MORPH_OPEN, _disc(radius))
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(wide)
    shared = np.bincount(labels[inside > 0], minlength=count)
    kept = shared > 0.2 * boxes[:, cv2.CC_STAT_AREA]
    kept[0] = False
    # Opening with a disc has rounded the corners. It has moved their tips inwards by 0.41 times the radius,
    # so dilate by this distance.
    corners = cv2.dilate(kept.astype(np.uint8)[labels], _disc(max(1, int(0.41 * radius)))) & whole
    return np.asarray(cv2.morphologyEx(corners, cv2.MORPH_CLOSE, _disc(max(2, radius // 3))), np.uint8)


def at_full_resolution(found: Bits, reduction: int, shape: tuple[int, ...]) -> Mask:
    """Return the mask of the specimen at full resolution.

    Besides the result, only a band of rows is in memory at a time.

    `found`: the result of `outline`. `reduction`: number of image pixels along the side of a reduced pixel.
    `shape`: height and width of the image.
    """
    import cv2

    height, width = shape
    mask = np.empty((height, width), np.uint8)
    reach = reduction // 2
    for band in bands_of(len(found), _BAND_PX):
        # Two rows more on either side: one for the interpolated values at the ends of the band, and one for
        # the erosion.
        above, below = max(0, band.start - 2), min(len(found), band.stop + 2)
        enlarged = cv2.resize(
            found[above:below].astype(np.float32),
            None,
            fx=reduction,
            fy=reduction,
            interpolation=cv2.INTER_LINEAR,
        )
        first, last = max(0, (band.start - 1) * reduction), min(height, (band.stop + 1) * reduction)
        rows = (enlarged[first - above * reduction : last - above * reduction, :width] > 0.5).view(np.uint8)
        # The slope filter responds about half a reduced pixel beyond an edge, so erode the mask by this
        # distance.
        eroded = np.asarray(cv2.erode(rows, square(2 * reach + 1)), np.uint8)
        own = slice(band.start * reduction, min(height, band.stop * reduction))
        mask[own] = eroded[own.start - first : own.stop - first]
    border = _NO_SUBSET_PX
    mask[:border], mask[-border:] = mask[border], mask[-border - 1]
    mask[:, :border], mask[:, -border:] = mask[:, [border]], mask[:, [-border - 1]]
    return mask.view(np.bool_)


def _disc(radius: int) -> Bits:
    import cv2

    size = (2 * radius + 1, 2 * radius + 1)
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, size), np.uint8)
