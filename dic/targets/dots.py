"""Detection of the centres of round dots.

The centre of a dot is its centroid, corrected for the shift that perspective causes.
"""

import numpy as np

from dic.errors import CalibrationError
from dic.targets.axes import Axes, XAxis, axes_in_image
from dic.targets.cells import along_short_vectors, lattice_of_regions
from dic.targets.lattice import LatticeShape, fits_lattice
from dic.targets.points import GridPoints
from dic.typing import Float, Grey, Indices, Mask

# Smallest share of the dots that must be found.
_SUFFICIENT = 0.9
# Distance that the blurred edge of a dot reaches beyond the dot.
_EDGE_PX = 2.5
# A dot is divided into this number of rings and spokes, over which the shift by perspective is integrated.
_RINGS, _SPOKES = 6, 24


def find_dots(grey: Grey, dots: tuple[int, int], pitch_mm: float, source: str, x_axis: XAxis) -> GridPoints:
    """Return the centres of a lattice of dots. `dic.targets.find.DotTarget` describes this target.

    Raises
    ------
    CalibrationError
        If fewer than 90 % of the dots are found, or the numbers of rows and columns differ from `dots`.
    """
    index, centre_px, boxes, signed = _lattice(grey, dots[0] * dots[1])
    if len(index) < max(16, _SUFFICIENT * dots[0] * dots[1]):
        raise _refusal(source, dots, f"{len(index)} dots in a lattice")
    counts = tuple(int(count) for count in np.ptp(index, axis=0) + 1)
    if sorted(counts) != sorted(dots):
        raise _refusal(source, dots, f"{counts[0]} × {counts[1]} dots")
    low = index.min(axis=0)
    spans = (range(int(low[0]), int(low[0]) + counts[0]), range(int(low[1]), int(low[1]) + counts[1]))
    centroid, area_px2 = _centroids(signed, centre_px, boxes)
    shape = LatticeShape.fit(index.astype(float), centroid)
    centroid -= _eccentricity(shape, index.astype(float), area_px2)

    middle = np.array([span[0] + (len(span) - 1) / 2 for span in spans])
    vectors = np.stack([shape.step(middle, 0), shape.step(middle, 1)])

    def possible(axes: Axes) -> bool:
        return tuple(len(spans[axis]) for axis in axes.lattice_axes) == tuple(dots)

    axes = axes_in_image(vectors, x_axis, source, possible)
    # A partly hidden dot is smaller than the others, and its centroid is shifted. Leave such dots out.
    size = area_px2 / _cell_px2(shape, index.astype(float))
    off = np.abs(size / np.median(size) - 1)
    sound = fits_lattice(index.astype(float), centroid) & (off < 6 * np.median(off) + 0.02)
    if np.count_nonzero(sound) < _SUFFICIENT * dots[0] * dots[1]:
        raise _refusal(source, dots, f"only {np.count_nonzero(sound)} whole dots")
    column_row, centroid = axes.columns_and_rows(index, spans)[sound], centroid[sound]
    by_row = np.lexsort((column_row[:, 0], column_row[:, 1]))
    return GridPoints.on_lattice(
        column_row[by_row], centroid[by_row], dots, pitch_mm, axes.warnings, axes.orientation
    )


def _lattice(grey: Grey, expected: int) -> tuple[Indices, Float, Indices, Grey]:
    """Find the largest lattice of blobs; return its blobs and an image in which the dots are bright.

    The blobs are given by lattice indices (n, 2), centres (n, 2) in px and bounding boxes (n, 4): left, top,
    width, height. If the dots are dark, the returned image is the negative of the given one.
    """
    best_index, best_centre = np.empty((0, 2), np.int64), np.empty((0, 2))
    best_boxes, best_image = np.empty((0, 4), np.int64), grey
    for width_px in (31, 15, 61, 121):
        if width_px > min(grey.shape) // 3:
            continue
        for signed in (-grey, grey):
            centres, areas, boxes = _blobs(signed, width_px)
            index, placed = lattice_of_regions(centres, areas)
            if len(index) > len(best_index):
                best_index, best_centre = along_short_vectors(index, centres[placed]), centres[placed]
                best_boxes, best_image = boxes[placed], signed
            if len(best_index) >= expected:
                return best_index, best_centre, best_boxes, best_image
    return best_index, best_centre, best_boxes, best_image


def _blobs(signed: Grey, width_px: int) -> tuple[Float, Float, Indices]:
    """Return the centres (n, 2), areas (n,) and bounding boxes (n, 4) of bright blobs.

    The width of a blob is at most `width_px`.
    """
    import cv2

    smooth = cv2.GaussianBlur(signed, (0, 0), max(0.7, width_px / 30))
    disc = cv2.getStructuringElement(cv2.MORPH_RECT, (width_px, width_px))
    height = cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, disc)
    wide = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * width_px + 1, 2 * width_px + 1))
    contrast = cv2.GaussianBlur(cv2.dilate(height, wide), (0, 0), width_px)
    seen = (height > 0.5 * contrast).astype(np.uint8)
    _, _, stats, centres = cv2.connectedComponentsWithStats(seen, connectivity=4)
    stats, centres = stats[1:].astype(np.int64), centres[1:]
    area = stats[:, cv2.CC_STAT_AREA]
    filled = area / (stats[:, cv2.CC_STAT_WIDTH] * stats[:, cv2.CC_STAT_HEIGHT])
    # An ellipse with axes along x and y fills pi/4 of its bounding box, an inclined ellipse less.
    like = (area >= 12) & (filled > 0.45) & (filled < 0.9)
    return centres[like].astype(np.float64), area[like].astype(np.float64), stats[like, :4]


def _centroids(signed: Grey, centre_px: Float, boxes: Indices) -> tuple[Float, Float]:
    """Return centroids (n, 2), px, and areas (n,), px², of dots, after subtracting the local background."""
    result, area = np.empty_like(centre_px), np.empty(len(centre_px))
    rows, columns = signed.shape
    for k, (left, top, width, height) in enumerate(boxes):
        reach = max(4, int(0.25 * max(width, height)))
        y = np.arange(max(0, top - reach), min(rows, top + height + reach))
        x = np.arange(max(0, left - reach), min(columns, left + width + reach))
        patch = signed[y[0] : y[-1] + 1, x[0] : x[-1] + 1].astype(np.float64)
        inside = _dot_pixels(patch)
        light = (patch - _background(patch, ~inside)) * inside
        total = light.sum()
        result[k] = (light.sum(axis=0) @ x / total, light.sum(axis=1) @ y / total)
        area[k] = total / np.percentile(light[inside], 80)
    return result, area


def _dot_pixels(patch: Float) -> Mask:
    """Return a mask of the pixels that belong to a dot or to its blurred edge.

    The mask is an ellipse with the second moments of the pixels above half height, enlarged by the width of
    the blurred edge. The border of a filled ellipse is at twice the standard deviation of its pixels, in
    every direction.
    """
    above = patch > (np.percentile(patch, 5) + np.percentile(patch, 95)) / 2
    places = np.argwhere(above).astype(np.float64)
    covariance = np.cov(places.T) + 0.1 * np.eye(2)
    every = np.argwhere(np.ones(patch.shape, bool)).reshape(*patch.shape, 2)
    relative = every - places.mean(axis=0)
    reach = np.sqrt(np.einsum("...i,ij,...j", relative, np.linalg.inv(covariance), relative)) / 2
    shortest_px = 2 * float(np.sqrt(np.linalg.eigvalsh(covariance)[0]))
    return np.asarray(reach < 1 + _EDGE_PX / shortest_px)


def _background(patch: Float, beside: Mask) -> Float:
    """Return the background of a dot: a plane fitted to the grey levels of the pixels in the mask `beside`.

    The fit rejects outliers, such as the pixels of an object that hides a neighbouring dot.
    """
    y, x = np.mgrid[: patch.shape[0], : patch.shape[1]]
    design = np.column_stack([np.ones(patch.size), x.ravel(), y.ravel()])
    used, level = beside.ravel(), patch.ravel()
    for _ in range(3):
        plane = np.linalg.lstsq(design[used], level[used], rcond=None)[0]
        away = np.abs(level - design @ plane)
        # 4.5 times the median of the absolute deviations is about three standard deviations.
        used = beside.ravel() & (away <= 4.5 * np.median(away[beside.ravel()]) + 1e-6)
    ground: Float = (design @ plane).reshape(patch.shape)
    return ground


def _eccentricity(shape: LatticeShape, index: Float, area_px2: Float) -> Float:
    """Return the differences (n, 2), px, between centroids of dots' images and images of dots' centres.

    In perspective the centroid of a dot's image is not the image of the dot's centre. The function computes
    the centroid as a sum over small elements of the dot, weighted by the areas of the elements in the image.
    """
    pixels_per_cell = _cell_px2(shape, index)
    radius = float(np.sqrt(np.median(area_px2 / pixels_per_cell) / np.pi))
    ring = np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS) * radius
    angle = np.arange(_SPOKES) * (2 * np.pi / _SPOKES)
    disc = np.stack([np.outer(ring, np.cos(angle)), np.outer(ring, np.sin(angle))], axis=-1).reshape(-1, 2)
    places = index[:, None] + disc
    weight = _cell_px2(shape, places)[..., None]
    seen: Float = (shape.map(places) * weight).sum(axis=1) / weight.sum(axis=1) - shape.map(index)
    return seen


def _cell_px2(shape: LatticeShape, index: Float) -> Float:
    """Return the area, px², that one cell of the lattice has in the image, at lattice indices (…, 2).

    The result has the shape (…,).
    """
    first, second = shape.step(index, 0), shape.step(index, 1)
    area: Float = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    return area


def _refusal(source: str, dots: tuple[int, int], got: str) -> CalibrationError:
    return CalibrationError(
        source,
        "find dots",
        f"{dots[0]} × {dots[1]} dots, at least {_SUFFICIENT:.0%} of them",
        got,
        "check that all dots are in view, sharp and evenly lit, and that --dots gives their numbers",
    )
