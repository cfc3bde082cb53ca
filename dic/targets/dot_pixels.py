"""The pixels from which the centre of a dot is measured.

Every pixel near a dot's edge is used, because only there the grey level depends on the dot's centre. Pixels
farther away, inside and outside the dot, show the gradient of the light. Without these pixels, a gradient of
the light looks like a shift of the dot; with a blur of 2 px this doubles the variance of the centre. Pixels
far from the edge are averaged in blocks.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.blobs import Blobs
from dic.typing import Float, Grey, Indices, Mask

# Every pixel up to this distance from the edge is a sample of its own.
_BAND_PX = 7.0
# Farther away, a square block of pixels is one sample; this is the number of pixels along its side.
_BLOCK_PX = 4
# The hole of a hollow dot begins deeper than this fraction of the dot's smaller semi-axis.
_RIM_OF_HOLLOW = 0.3
# For the map of the nearest dot, dots are drawn at this fraction of their size, so that no two dots touch.
_DRAWN = 0.9
_SPOKES = 32


@dataclass(frozen=True)
class DotPixels:
    """Samples of the grey levels around n dots."""

    places_px: Float
    """Shape (n, m, 2)."""
    level: Float
    """Shape (n, m). Mean grey level of each sample."""
    weight: Float
    """Shape (n, m). Number of pixels in each sample; 0 for places that are not used."""

    @classmethod
    def around(cls, grey: Grey, blobs: Blobs, hollow: Mask, nearest: Indices, which: Indices) -> "DotPixels":
        """Return the samples around the dots with the given numbers. `nearest` is `nearest_dot`'s map."""
        every = [_samples(grey, blobs, bool(hollow[k]), nearest, int(k)) for k in which]
        most = max(len(level) for _, level, _ in every)
        places, level, weight = np.zeros((len(every), most, 2)), *np.zeros((2, len(every), most))
        for k, (its_places, its_level, its_weight) in enumerate(every):
            size = len(its_level)
            places[k, :size], level[k, :size], weight[k, :size] = its_places, its_level, its_weight
            places[k, size:] = blobs.centre_px[which[k]] + 1.0
        return cls(places, level, weight)


def nearest_dot(blobs: Blobs, shape: tuple[int, ...]) -> Indices:
    """Return a map (height, width) of labels: pixels whose nearest dot is the same have the same label."""
    import cv2

    angle = np.arange(_SPOKES) * (2 * np.pi / _SPOKES)
    circle = _DRAWN * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    factor = 2 * np.linalg.cholesky(blobs.covariance_px2)
    rims = np.rint(blobs.centre_px[:, None] + circle @ np.swapaxes(factor, 1, 2)).astype(np.int32)
    free = np.ones(shape, np.uint8)
    cv2.fillPoly(free, list(rims), 0)
    _, labels = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_CCOMP)
    return np.asarray(labels)


def distance_from_ellipses(pixels: Float, centre: Float, shape: Float) -> tuple[Float, Float, Float]:
    """Return distances (n, m) from n ellipses, px, their gradients by the centre, and by the shape.

    The ellipse is ``d·Q·d = 1`` with ``d = p − c``. The distance is exact to first order near the ellipse:
    ``t = (ρ − 1)/|∇ρ|`` with ``ρ² = d·Q·d``. The gradient by the shape, (n, m, 3), is for Q's elements xx, xy
    and yy.
    """
    d = pixels - centre[:, None]
    product = d @ shape
    rho = np.sqrt(np.maximum((product * d).sum(axis=-1), 1e-6))
    slope = np.maximum(np.linalg.norm(product, axis=-1) / rho, 1e-6)
    normal = product / (rho * slope)[..., None]
    terms = np.stack([d[..., 0] ** 2, 2 * d[..., 0] * d[..., 1], d[..., 1] ** 2], axis=-1)
    return (rho - 1) / slope, -normal, terms / (2 * rho * slope)[..., None]


def _samples(
    grey: Grey, blobs: Blobs, hollow: bool, nearest: Indices, number: int
) -> tuple[Float, Float, Float]:
    """Return the samples around one dot: places (m, 2), grey levels (m,) and numbers of pixels (m,)."""
    centre, covariance = blobs.centre_px[number], blobs.covariance_px2[number]
    smaller = 2 * float(np.sqrt(np.linalg.eigvalsh(covariance)[0]))
    beyond = max(_BAND_PX, smaller)
    half = np.ceil(2 * np.sqrt(np.diag(covariance)) + beyond).astype(int)
    x0, y0 = np.rint(centre).astype(int)
    y, x = np.mgrid[y0 - half[1] : y0 + half[1] + 1, x0 - half[0] : x0 + half[0] + 1]
    height, width = grey.shape
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    column, row = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    own = ~inside | (nearest[row, column] == nearest[y0, x0])
    # Take samples up to half of the distance to the nearest neighbour. Use the same limit on the opposite
    # side, where a neighbour may exist that was not found.
    own &= own[::-1, ::-1] & inside
    places = np.stack([x, y], axis=-1).astype(np.float64)
    level = grey[row, column].astype(np.float64)
    quadric = np.linalg.inv(4 * covariance)
    distance = distance_from_ellipses(places.reshape(1, -1, 2), centre[None], quadric[None])[0]
    distance = distance.reshape(x.shape)
    own &= (distance < beyond) & (~np.bool_(hollow) | (distance > -_RIM_OF_HOLLOW * smaller))
    near = own & (np.abs(distance) < _BAND_PX)
    blocks = [_blocks(values) for values in (own & ~near, level, places[..., 0], places[..., 1])]
    whole = blocks[0].all(axis=-1)
    far, far_x, far_y = (values[whole].mean(axis=-1) for values in blocks[1:])
    return (
        np.concatenate([places[near], np.stack([far_x, far_y], axis=-1)]),
        np.concatenate([level[near], far]),
        np.concatenate([np.ones(np.count_nonzero(near)), np.full(len(far), float(_BLOCK_PX**2))]),
    )


def _blocks(values: Float) -> Float:
    """Return the values (height, width) in square blocks, shape (blocks along y, blocks along x, values)."""
    side = _BLOCK_PX
    rows, columns = (size // side for size in values.shape)
    parts = values[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return parts.swapaxes(1, 2).reshape(rows, columns, side * side)
