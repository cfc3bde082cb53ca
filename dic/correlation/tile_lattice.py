"""The lattice of a pattern in one tile of an image: the peaks of its autocorrelation.

The autocorrelation of a random pattern falls to nearly 0 beyond the size of its speckles. That of a lattice
rises again to nearly 1 at every displacement that takes the lattice to itself.
"""

import numpy as np

from dic.image.fourier import irfft2, next_fast_len, rfft2
from dic.typing import Float, Grey, Indices, Mask

_REACH = 0.4
"""Largest displacement that is examined, as a share of a tile's width."""

_LIGHT = 0.4
"""Width of the moving mean that is taken for uneven light, as a share of a tile's width."""

_ALIKE = 0.5
"""Smallest autocorrelation of a pattern that counts as repeating."""

_PARTLY = 0.15
"""Smallest autocorrelation of a pattern of which a part may repeat."""

_CLEAR = 4.5
"""It is also at least this multiple of the standard deviation that a random pattern's autocorrelation has."""

_SHORTEST_PX = 3.0

_VALLEY = 0.15
"""Between two periods, the autocorrelation falls by at least this much."""

_EQUAL = 4.0, 0.15
"""Periods lack likeness by at most this multiple of the least lack, or by this much."""

_OF_LINES = 0.1
"""A pattern of lines has at most this share of its squared slopes along the lines."""

_CORNER = 0.8
"""Above this share of the Nyquist frequency, along x and along y, there is hardly anything but noise."""

_COARSE_PX = 1.5
"""Standard deviation of the smoothing with which slopes are examined."""

_ASIDE = 0.3
"""The second vector reaches at least this part of the first vector's length beside the first."""

_FITS = 0.2
"""A peak belongs to a lattice if it lies within this part of the period of one of its points."""

_MOST_ALIKE = 3
"""Number of the most alike displacements that are kept."""


class MixedPattern(Exception):
    """A part of a tile may repeat, but the whole tile does not."""


def tile_lattice(grey: Grey, inside: Mask) -> tuple[Float, float, Float] | None:
    """Return vectors, likeness and most alike displacements of a tile's lattice; None for other patterns.

    `grey`, `inside`, shape (side, side): grey levels, and True for pixels of the specimen.

    Raises `MixedPattern` if smaller tiles may show a lattice.
    """
    pattern, weight = _without_light(grey, inside)
    power, noise = _spectrum(pattern, weight)
    measured = _autocorrelation(power, noise, inside)
    if measured is None:
        return None
    likeness, random_std = measured
    places = _maxima(likeness, np.maximum(_PARTLY, _CLEAR * random_std))
    if not len(places):
        return None
    if likeness[tuple(places.T)].max() < _ALIKE:
        raise MixedPattern
    places = places[likeness[tuple(places.T)] >= _ALIKE]
    across_lines = _across_lines(pattern, inside, noise)
    peaks = _peaks(likeness, places, across_lines)
    if not len(peaks):
        return None
    most_alike = np.resize(peaks[np.argsort(-peaks[:, 2])[:_MOST_ALIKE], :2], (_MOST_ALIKE, 2))
    lack = 1.0 - peaks[:, 2]
    equal = peaks[lack <= max(_EQUAL[0] * float(lack.min()), _EQUAL[1])]
    lengths = np.hypot(equal[:, 0], equal[:, 1])
    equal, lengths = equal[np.argsort(lengths)], np.sort(lengths)
    if across_lines is not None:
        vector = _next_line(equal[:, :2], across_lines)
        return vector[None], float(min(1.0, equal[0, 2])), vector * np.arange(1, _MOST_ALIKE + 1)[:, None]
    first = equal[0, :2]
    aside = np.abs(first[0] * equal[:, 1] - first[1] * equal[:, 0]) / lengths[0]
    others = equal[aside > _ASIDE * lengths[0]]
    vectors = np.array([first, others[0, :2]]) if len(others) else first[None]
    return _refined(vectors, equal[:, :2]), float(min(1.0, equal[0, 2])), most_alike


def _spectrum(pattern: Grey, weight: Grey) -> tuple[Float, float]:
    """Return the power spectrum of a tile without wrapping, and the variance of its white noise."""
    size = next_fast_len(int(np.ceil((1 + _REACH) * len(pattern))))
    power = np.square(np.abs(rfft2(pattern, (size, size))))
    high = (np.abs(frequency(size)) > _CORNER / 2 for frequency in (np.fft.fftfreq, np.fft.rfftfreq))
    corner = power[np.ix_(*high)]
    return power, float(corner.mean()) / max(1.0, float(weight.sum()))


def _autocorrelation(power: Float, noise: float, inside: Mask) -> tuple[Float, Float] | None:
    """Return the autocorrelation of a tile, and the standard deviation of that of a random pattern.

    Both arrays have the shape (2 n + 1, 2 n + 1), with the displacement 0 in the middle. The result is None
    without any pattern.
    """
    side, size = len(inside), len(power)
    reach = int(_REACH * side)
    at = np.arange(-reach, reach + 1)
    middle = np.ix_(at, at)
    if inside.all():
        overlap = np.outer(side - np.abs(at), side - np.abs(at)).astype(np.float32)
    else:
        shape = np.square(np.abs(rfft2(inside.astype(np.float32), (size, size))))
        overlap = np.maximum(irfft2(shape, (size, size))[middle], 1.0)
    likeness = irfft2(power, (size, size))[middle] / overlap
    variance = float(likeness[reach, reach]) - noise
    if variance <= noise:
        return None
    likeness /= variance
    likeness[reach, reach] = 1.0
    # The displacement at which the autocorrelation has fallen to a half, along x and along y.
    halves = [
        1 + int(np.argmax(np.append(row[reach + 1 :], -1.0) < 0.5))
        for row in (likeness[reach], likeness[:, reach])
    ]
    # The square of a Gaussian with these half widths has this integral.
    speckle_px2 = np.pi / (2 * np.log(2)) * halves[0] * halves[1]
    return likeness, np.sqrt(speckle_px2 / overlap)


def _without_light(grey: Grey, inside: Mask) -> tuple[Grey, Grey]:
    """Return the grey levels without uneven light, 0 outside the region, and the region as numbers."""
    import cv2

    weight = inside.astype(np.float32)
    box = (int(_LIGHT * len(grey)) | 1,) * 2
    flat = (grey - grey[inside].mean()) * weight
    share = cv2.boxFilter(weight, -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    light = cv2.boxFilter(flat, -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return (flat - light / np.maximum(share, 1.0)) * weight, weight


def _across_lines(pattern: Grey, inside: Mask, noise: float) -> Float | None:
    """Return the direction (x, y) across a pattern of lines; None for other patterns.

    `noise`: variance of the white noise.
    """
    import cv2

    smooth = cv2.GaussianBlur(pattern, (0, 0), _COARSE_PX)
    edge = 2 * int(3 * _COARSE_PX) + 1
    inner = cv2.erode(inside.view(np.uint8), np.ones((edge, edge), np.uint8), borderValue=0).view(np.bool_)
    slopes = np.stack([cv2.Sobel(smooth, cv2.CV_32F, 1 - k, k, scale=1 / 8)[inner] for k in (0, 1)])
    # Variance of the slopes of white noise after a Gaussian filter
    of_noise = noise / (8 * np.pi * _COARSE_PX**4)
    values, directions = np.linalg.eigh(slopes @ slopes.T / slopes.shape[1] - of_noise * np.eye(2))
    return directions[:, 1] if values[0] < _OF_LINES * values[1] else None


def _maxima(likeness: Float, least: Float) -> Indices:
    """Return row and column of the local maxima that are high enough, shape (n, 2).

    Of two opposite displacements, one is returned.
    """
    import cv2

    reach = len(likeness) // 2
    surface = likeness[: reach + 1].astype(np.float32)
    highest = surface >= cv2.dilate(surface, np.ones((3, 3), np.uint8))
    highest &= likeness[: reach + 1] >= least[: reach + 1]
    highest[0] = highest[:, 0] = highest[:, -1] = False
    highest[reach, reach:] = False
    places = np.argwhere(highest)
    return np.asarray(places[np.hypot(*(places - reach).T) >= _SHORTEST_PX])


def _peaks(likeness: Float, places: Indices, across_lines: Float | None) -> Float:
    """Return the displacements (x, y) and heights of the maxima at `places` that a valley parts from 0.

    Shape (n, 3).
    """
    reach, peaks = len(likeness) // 2, []
    if across_lines is not None:
        places = places[np.abs((places - reach)[:, ::-1] @ across_lines) >= _SHORTEST_PX]
    for row, column in places:
        steps = np.linspace(0.0, 1.0, 2 * int(max(reach - row, abs(reach - column))) + 1)
        down, aside = (np.rint(reach + steps * (end - reach)).astype(int) for end in (row, column))
        height = likeness[row, column]
        if likeness[down, aside].min() > height - _VALLEY:
            continue
        dy, top_y = _vertex(likeness[row - 1 : row + 2, column])
        dx, top_x = _vertex(likeness[row, column - 1 : column + 2])
        peaks.append((reach - column - dx, reach - row - dy, top_x + top_y - height))
    return np.array(peaks).reshape(-1, 3)


def _vertex(three: Float) -> tuple[float, float]:
    """Return the place and the height of the vertex of a parabola through values at -1, 0 and 1."""
    before, here, after = three
    curve = before - 2 * here + after
    if curve >= 0.0:
        return 0.0, float(here)
    place = float(np.clip((before - after) / (2 * curve), -0.5, 0.5))
    return place, float(here - (before - after) * place / 4)


def _next_line(peaks: Float, across_lines: Float) -> Float:
    """Return the vector from a line to the next one, fitted to peaks, of which the first is the nearest."""
    lengths = np.hypot(*peaks.T)
    wave = across_lines / np.abs(peaks[lengths <= 2 * lengths[0]] @ across_lines).min()
    for reach in (3.0, 6.0, 12.0, 24.0, 48.0):
        near = peaks[lengths < reach * lengths[0]]
        lines = np.rint(near @ wave)
        fits = np.abs(near @ wave - lines) < _FITS
        if np.linalg.matrix_rank(near[fits]) == 2 and lines[fits].any():
            wave = np.linalg.lstsq(near[fits], lines[fits], rcond=None)[0]
    return np.asarray(wave / (wave @ wave))


def _refined(vectors: Float, peaks: Float) -> Float:
    """Return the shortest vectors of a lattice, fitted to its peaks at whole multiples of the given ones."""
    for reach in (1.6, 3.2, 6.4, 12.8, 25.6):
        near = peaks[np.hypot(*peaks.T) < reach * np.hypot(*vectors[-1])]
        multiples = near @ np.linalg.pinv(vectors)
        whole = np.rint(multiples)
        fits = (np.abs(multiples - whole).max(axis=1) < _FITS) & whole.any(axis=1)
        if len(vectors) == 1:
            aside = near @ np.array([-vectors[0, 1], vectors[0, 0]])
            fits &= np.abs(aside) < _FITS * (vectors[0] @ vectors[0])
        if np.linalg.matrix_rank(whole[fits]) == len(vectors):
            vectors = np.linalg.lstsq(whole[fits], near[fits], rcond=None)[0]
    if len(vectors) == 2:
        a, b = vectors
        b = b - np.rint(a @ b / (a @ a)) * a
        vectors = np.array(sorted((a, b), key=lambda v: float(v @ v)))
    return vectors
