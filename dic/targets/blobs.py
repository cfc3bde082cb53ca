"""Detection of blobs with the shape of an ellipse: the first, rough step of finding dots.

The image is compared with a local threshold. This threshold is the mean of the darkest and the brightest grey
level in the neighbourhood. The connected regions above and below the threshold are the candidates. A ring
counts as a blob whose hole is filled.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.targets.sampled_image import as_bytes
from dic.typing import Float, Grey, Mask

# Size of the neighbourhood, px. The image is first reduced until a dot is between a few and 24 px wide.
_NEIGHBOURHOOD_PX = 31
_SMALLEST_LEVEL_PX = 96
# Lowest local contrast of a blob, as a fraction of the contrast that 2 % of the pixels exceed.
_CONTRAST = 0.25
# Lowest local contrast of a blob, in units of the standard deviation of the noise.
_OVER_NOISE = 6.0
# Smallest area of a blob, px².
_SMALLEST_PX2 = 12
# Allowed range for the area of a region divided by the area of the ellipse with the same second moments. The
# ratio is 1 for an ellipse.
_LIKE_ELLIPSE = (0.86, 1.08)
# Largest ratio of the axes of an ellipse. A circle seen at 75° reaches 3.9.
_SLENDER = 4.0


@dataclass(frozen=True)
class Blobs:
    """Elliptic regions of the image, all darker or all brighter than their surroundings."""

    centre_px: Float
    """Shape (n, 2). Centroids."""
    area_px2: Float
    """Shape (n,). Areas, with holes filled."""
    covariance_px2: Float
    """Shape (n, 2, 2). Second moments about the centroids. For an ellipse with the semi-axis a, the moment
    along a is a²/4.
    """
    dark: bool
    """True if the blobs are darker than their surroundings."""

    def __len__(self) -> int:
        return len(self.centre_px)

    def only(self, which: NDArray[np.int64]) -> "Blobs":
        """Return the blobs with the given numbers."""
        return Blobs(self.centre_px[which], self.area_px2[which], self.covariance_px2[which], self.dark)


def find_blobs(grey: Grey) -> Iterator[Blobs]:
    """Yield the blobs of an image, for blobs of several sizes, and for dark and bright blobs.

    The resolution of the image is halved repeatedly. In each reduced image, the function finds blobs between
    a few px and about 24 px wide. The positions in the results are in px of the full image.
    """
    import cv2

    level = as_bytes(grey)
    levels = [level]
    while min(levels[-1].shape) // 2 >= _SMALLEST_LEVEL_PX:
        levels.append(np.asarray(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)))
    # A reduced pixel covers 2 × 2 finer pixels. Its centre is half a fine pixel away from the centre of the
    # first one, along each axis.
    for reduction, image in reversed(list(enumerate(levels))):
        scale = 2**reduction
        for blobs in _blobs_of_level(image):
            yield Blobs(
                (blobs.centre_px + 0.5) * scale - 0.5,
                blobs.area_px2 * scale**2,
                blobs.covariance_px2 * scale**2,
                blobs.dark,
            )


def _blobs_of_level(image: NDArray[np.uint8]) -> Iterator[Blobs]:
    """Yield the dark blobs, then the bright blobs, that are smaller than the neighbourhood."""
    import cv2

    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0))
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (_NEIGHBOURHOOD_PX, _NEIGHBOURHOOD_PX))
    side = (_NEIGHBOURHOOD_PX, _NEIGHBOURHOOD_PX)
    low = cv2.blur(cv2.erode(smooth, square).astype(np.float32), side)
    high = cv2.blur(cv2.dilate(smooth, square).astype(np.float32), side)
    contrast = high - low
    enough = contrast > max(_CONTRAST * float(np.percentile(contrast[::4, ::4], 98)), _noise_floor(image))
    dark = enough & (smooth < (low + high) / 2)
    regions = [_Regions.of(mask, enough) for mask in (dark, ~dark)]
    for region, holes, is_dark in ((regions[0], regions[1], True), (regions[1], regions[0], False)):
        yield region.filled_with(holes).ellipses(is_dark)


def _noise_floor(image: NDArray[np.uint8]) -> float:
    """Return the contrast that noise alone reaches in a smoothed neighbourhood, grey levels."""
    # The Gauss filter with σ = 1 px divides the noise by 2√π. The extremes among 31 × 31 px of noise are
    # about ±3.3 standard deviations.
    return max(8.0, float(_OVER_NOISE * noise_of(image.astype(np.float32)) / (2 * np.sqrt(np.pi)) * 1.8))


def noise_of(grey: Grey) -> float:
    """Return an estimate of the standard deviation of an image's noise, grey levels.

    The estimate comes from second differences of the grey levels. The standard deviation of second
    differences is √6 times that of the pixels.
    """
    sample = grey[::3]
    second = sample[:, :-2] - 2 * sample[:, 1:-1] + sample[:, 2:]
    return float(np.median(np.abs(second))) * 1.48 / float(np.sqrt(6.0))


@dataclass(frozen=True)
class _Regions:
    """Connected regions: number of pixels, sums of x, y, x², xy, y², shape (n, 6), and bounding boxes.

    `plain` is True for a region in which most pixels have too little contrast, such as the background far
    from all dots.
    """

    sums: Float
    boxes: NDArray[np.int64]
    on_rim: Mask
    plain: Mask

    @classmethod
    def of(cls, mask: Mask, enough: Mask) -> "_Regions":
        import cv2

        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        boxes = stats[:, :4].astype(np.int64)
        height, width = mask.shape
        # Label 0 is everything outside the mask. Most regions of a noisy image are too small to be counted.
        kept = (stats[:, cv2.CC_STAT_AREA] >= 3) & (boxes[:, 2:].max(axis=1) <= 2 * _NEIGHBOURHOOD_PX)
        kept[0] = False
        number = np.full(count, -1, np.int64)
        number[kept] = np.arange(np.count_nonzero(kept))
        y, x = np.nonzero(kept[labels])
        of = number[labels[y, x]]
        size = int(np.count_nonzero(kept))
        terms = (None, x, y, x * x, x * y, y * y)
        sums = np.stack([np.bincount(of, weights=term, minlength=size) for term in terms], axis=1)
        plain = np.bincount(of, weights=enough[y, x], minlength=size) < sums[:, 0] / 2
        left, top, across, down = boxes[kept].T
        rim = (left == 0) | (top == 0) | (left + across == width) | (top + down == height)
        return cls(sums.astype(np.float64), boxes[kept], rim, plain)

    def filled_with(self, holes: "_Regions") -> "_Regions":
        """Return these regions with their holes filled; a hole is one of the regions in `holes`."""
        from scipy.spatial import KDTree

        if not len(self.sums) or not len(holes.sums):
            return self
        centre, hole_centre = (each.sums[:, 1:3] / each.sums[:, :1] for each in (self, holes))
        away, nearest = KDTree(hole_centre).query(centre)
        inner, outer = holes.boxes[nearest], self.boxes
        within = (inner[:, :2] > outer[:, :2]).all(axis=1)
        within &= (inner[:, :2] + inner[:, 2:] < outer[:, :2] + outer[:, 2:]).all(axis=1)
        within &= away < 0.25 * outer[:, 2:].min(axis=1)
        filled = self.sums + np.where(within[:, None], holes.sums[nearest], 0.0)
        return _Regions(filled, outer, self.on_rim, self.plain)

    def ellipses(self, dark: bool) -> Blobs:
        """Return the regions that have the shape of an ellipse and do not touch the image's rim."""
        area = self.sums[:, 0]
        centre = self.sums[:, 1:3] / area[:, None]
        xx, xy, yy = self.sums[:, 3:].T / area
        # A pixel is a square, not a point. Its area adds 1/12 px² to the second moments.
        xx, yy = xx - centre[:, 0] ** 2 + 1 / 12, yy - centre[:, 1] ** 2 + 1 / 12
        xy = xy - centre[:, 0] * centre[:, 1]
        determinant = np.maximum(xx * yy - xy**2, 1e-9)
        likeness = area / (4 * np.pi * np.sqrt(determinant))
        slender2 = (xx + yy) ** 2 / (4 * determinant)
        limit = (_SLENDER**2 + 1) ** 2 / (4 * _SLENDER**2)
        like = (area >= _SMALLEST_PX2) & ~self.on_rim & ~self.plain & (slender2 < limit)
        like &= (likeness > _LIKE_ELLIPSE[0]) & (likeness < _LIKE_ELLIPSE[1])
        covariance = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
        return Blobs(centre[like], area[like], covariance[like], dark)
