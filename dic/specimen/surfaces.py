"""Find the surfaces with speckles: first strong windows, then all windows that resemble the strong ones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.image.threads import bands_of, with_neighbours
from dic.specimen.texture import EVERY_DIRECTION, TextureMaps, eigenvalues
from dic.typing import Float, Grey, Mask

Bits = NDArray[np.uint8]
"""A mask for OpenCV, with the values 0 and 1."""

# Limits by which `first_look` chooses the windows that may show the specimen.
_LEAST_SPREAD = 0.4
_WEAK = 0.03
"""A window with less than this fraction of the strong windows' texture is background."""

# Limits by which `_like_the_main_one` accepts other surfaces, relative to the main surface.
_LEAST_AREA, _LEAST_STRENGTH, _LEAST_ISOTROPY, _LEAST_LIKENESS = 0.15, 0.05, 0.5, 0.8

# Limits by which `find_surfaces` accepts further windows, relative to the windows inside the surfaces.
_HALF = 0.58
"""A window on the straight edge of a surface has this share of texture: half, and a part from the edge."""
_LEAST_SHARPNESS = 0.3
_TONE, _TONE_SPREADS = 0.3, 4.0
"""A window's brightness may differ from the specimen's by 30 %, or by 4 times the median difference."""

_AS_FULL_ENERGY = 2.7
"""Ratio of mean energy to smaller eigenvalue in a window with few speckles. With many speckles it is 2."""

_SPARSE = 4
"""Fields that change slowly are computed at every fourth pixel."""

_SAMPLE = 1000
"""Number of values that is enough for a median."""

_BAND_PX = 256
"""Height of the bands of rows in which windows are compared, reduced pixels."""


@dataclass(frozen=True)
class Surfaces:
    """The surfaces with speckles, in reduced pixels."""

    windows: Bits
    """1 at the centres of windows that are at least half full of the specimen's texture."""
    inside: Bits
    """1 at the centres of windows that lie on the specimen with certainty."""
    energy: Grey
    """Mean energy of the specimen's texture at each pixel. Beside the specimen it is extrapolated, and far
    from the specimen it is infinite.
    """


@dataclass(frozen=True)
class FirstLook:
    """The texture in each window of the image."""

    light: Grey
    """Brightness above the darkest parts of the image."""
    dense: Mask
    """True where strong slopes in every direction fill the window."""
    weak: Mask
    """True where there is texture, but little compared with the strong windows."""
    chosen: Mask
    """True where a window may show the specimen."""


def first_look(maps: TextureMaps, within: Mask | None = None) -> FirstLook:
    """Return the texture in each window; `within` limits the windows that may show the specimen."""
    dark, bright = np.percentile(maps.grey[::_SPARSE, ::_SPARSE], (0.5, 99.0))
    floor = np.float32(0.05 * (bright - dark) or 1.0)
    light = np.maximum(maps.grey - np.float32(dark), np.float32(0.0)) + floor
    # Photon noise has a variance proportional to the brightness. So the smaller eigenvalue of the structure
    # tensor divided by the brightness measures the signal against the noise.
    strength = maps.weakest / light
    dense = maps.in_every_direction & (maps.spread > _LEAST_SPREAD)
    good = maps.above_noise & dense
    if within is not None:
        good &= within
    strong = float(np.percentile(strength[good], 90)) if good.any() else 0.0
    weak = maps.above_noise & (strength <= np.float32(_WEAK * strong))
    return FirstLook(light, dense, weak, good & ~weak)


def find_surfaces(maps: TextureMaps, look: FirstLook) -> Surfaces | None:
    """Return the main surface and the surfaces that resemble it; None if there is no surface."""
    import cv2

    core = _like_the_main_one(maps, look)
    if core is None:
        return None
    inside = cv2.erode(core, square(maps.window))
    inside = np.asarray(inside if inside.any() else core, np.uint8)
    # One map after another, because each takes a quarter of the memory of the image.
    energy = _around(maps.window, inside, maps.weakest, far=np.inf)
    # Compare windows with the sharpness of the specimen nearby, because one side of the specimen may be
    # blurred.
    sharpness = _around(maps.window, inside, _mean(maps, maps.curvature))
    sharpness /= energy
    energy *= np.float32(_AS_FULL_ENERGY)
    windows = _resembling(maps, inside, energy, sharpness)
    del sharpness
    windows &= cv2.dilate(windows & _as_bright(maps, look, inside), square(maps.window + 2))
    half = square(maps.window // 2 | 1)
    windows = cv2.morphologyEx(cv2.morphologyEx(windows, cv2.MORPH_CLOSE, half), cv2.MORPH_OPEN, half)
    windows = _large_parts(np.asarray(windows, np.uint8), inside)
    inside &= cv2.erode(windows, square(3))
    return Surfaces(windows, inside, energy) if inside.any() else None


def _like_the_main_one(maps: TextureMaps, look: FirstLook) -> Bits | None:
    """Return the windows of the main surface, and of other surfaces with similar texture.

    The main surface is the one with the most texture in every direction, summed over its area.
    """
    import cv2

    opened = cv2.morphologyEx(look.chosen.view(np.uint8), cv2.MORPH_OPEN, square(maps.window // 2 | 1))
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(opened)
    if count < 2:
        return None
    area = boxes[1:, cv2.CC_STAT_AREA].astype(np.float64)
    large = 1 + np.flatnonzero(area >= _LEAST_AREA * area.max())
    area = area[large - 1]
    values = np.array([_medians(maps, look, labels, boxes, int(label)) for label in large])
    main = int(np.argmax(area * values[:, 0] * values[:, 1]))
    least = (_LEAST_STRENGTH, _LEAST_ISOTROPY, _LEAST_LIKENESS)
    similar = (values >= np.array(least) * values[main]).all(axis=1) & (area >= _LEAST_AREA * area[main])
    kept = np.zeros(count, np.uint8)
    kept[large[similar]] = 1
    return kept[labels]


def _medians(maps: TextureMaps, look: FirstLook, labels: Float, boxes: Float, label: int) -> list[float]:
    """Return a surface's strength, ratio of eigenvalues and spread: medians over its windows."""
    x, y, width, height = (int(value) for value in boxes[label][:4])
    box = slice(y, y + height), slice(x, x + width)
    own = labels[box] == label
    strength = maps.weakest[box] / look.light[box]
    ratio = maps.weakest[box] / np.maximum(maps.strongest[box], np.float32(1e-30))
    return [_median(values, own) for values in (strength, ratio, maps.spread[box])]


def _median(values: Grey | Float, own: Mask) -> float:
    """Return the median over a mask, from every fourth row and column if these have enough values."""
    sparse = (slice(None, None, _SPARSE), slice(None, None, _SPARSE))
    sample = values[sparse][own[sparse]]
    return float(np.median(sample if sample.size >= _SAMPLE else values[own]))


def _as_bright(maps: TextureMaps, look: FirstLook, inside: Bits) -> Bits:
    """Return the windows that are about as bright as the specimen around them.

    The brightness of a window at the edge is a mean of the specimen and the background. So it is enough if a
    neighbouring window has the right brightness.
    """
    tone = np.divide(look.light, _around(maps.window, inside, look.light))
    np.abs(np.log(tone, out=tone), out=tone)
    same = tone < max(_TONE, _TONE_SPREADS * _median(tone, inside > 0))
    return np.asarray(same).view(np.uint8)


def _around(window: int, inside: Bits, of: Grey, far: float = 1.0) -> Grey:
    """Return the usual value of a map on the specimen around every pixel, also outside the specimen.

    The usual value is a weighted geometric mean over the pixels in `inside`. Far from these pixels it is
    `far`.
    """
    import cv2

    sparse = (slice(None, None, _SPARSE), slice(None, None, _SPARSE))
    shape, known = inside.shape[::-1], inside[sparse].astype(np.float32)
    if not known.any():
        return np.full(inside.shape, np.median(of[inside > 0]), np.float32)
    side = (window + 2 | 1,) * 2

    def smooth(of: Grey) -> Grey:
        return np.asarray(cv2.blur(cv2.blur(of, side), side), np.float32)

    weight = smooth(known)
    logarithms = np.log(np.maximum(of[sparse], np.float32(1e-30))) * known
    mean = np.where(weight > 1e-5, np.exp(smooth(logarithms) / np.maximum(weight, np.float32(1e-5))), far)
    spread = np.repeat(np.repeat(mean.astype(np.float32), _SPARSE, axis=0), _SPARSE, axis=1)
    return np.ascontiguousarray(spread[: shape[1], : shape[0]])


def _resembling(maps: TextureMaps, inside: Bits, energy: Grey, sharpness: Grey) -> Bits:
    """Return the windows at least half of which has texture as strong, dense and sharp as the specimen's.

    The energy of each pixel is limited to the specimen's mean energy. Without this limit, a strong edge
    between a dark specimen and a bright background would hide the texture beside the edge.
    """
    weakest, relative = np.empty_like(energy), np.empty_like(energy)
    every_direction = np.empty(energy.shape, np.bool_)
    # The weighted products and their means would take as much memory as all other maps together.
    for band in bands_of(len(energy), _BAND_PX):
        around = with_neighbours(band, len(energy), maps.window)
        limit = np.maximum(energy[around], maps.energy[around])
        weight: Grey = np.reciprocal(np.maximum(limit, np.float32(1e-30)))
        own_rows = slice(band.start - around.start, band.stop - around.start)
        products = maps.slopes.of_rows(around).weighted(weight)
        weakest[band], strongest = eigenvalues(*(_mean(maps, of)[own_rows] for of in products))
        total = np.maximum(weakest[band] + strongest, np.float32(1e-30))
        bend = _mean(maps, maps.curvature[around] * weight)[own_rows]
        relative[band] = bend / np.maximum(total * sharpness[band], np.float32(1e-30))
        every_direction[band] = weakest[band] > np.float32(EVERY_DIRECTION) * strongest
    own = inside > 0
    full = weakest > _HALF * _median(weakest, own)
    sharp = relative > _LEAST_SHARPNESS * _median(relative, own)
    return np.asarray(full & every_direction & sharp).view(np.uint8)


def _large_parts(windows: Bits, inside: Bits) -> Bits:
    """Return the large connected parts that lie inside the surfaces by a fifth of their area or more."""
    import cv2

    count, labels, boxes, _ = cv2.connectedComponentsWithStats(windows)
    if count < 2:
        return np.zeros_like(windows)
    area = boxes[:, cv2.CC_STAT_AREA].astype(np.float64)
    shared = np.bincount(labels[inside > 0], minlength=count)
    kept = (area >= 0.1 * area[1:].max()) & (shared >= 0.2 * area)
    kept[0] = False
    return np.asarray(kept.astype(np.uint8)[labels])


def _mean(maps: TextureMaps, of: Grey) -> Grey:
    import cv2

    return np.asarray(cv2.blur(of, (maps.window, maps.window)), np.float32)


def square(width: int) -> Bits:
    """Return a square for OpenCV's morphology."""
    return np.ones((width, width), np.uint8)
