"""The size of the speckles in an image, and the blur of their edges."""

import numpy as np

from dic.errors import CorrelationError
from dic.typing import Float, Grey, Mask

_LIGHT_PX = 101
"""Width of the moving mean that separates uneven light from speckles, which are much smaller."""

# Standard deviations of the two blurs that `edge_blur` applies to the image.
_FINE_PX, _COARSE_PX = 1.0, 2.0
# The pixels with the largest grey level gradients count as edges. This number is their share of all pixels.
_EDGES = 0.05
_FEWEST_EDGES = 50


def even_light(grey: Grey, region: Mask) -> Float:
    """Return the image without uneven light: grey levels minus their moving mean over 101 × 101 px.

    The result has the shape (height, width) and is 0 outside the region.

    `region` has the shape (height, width).
    """
    import cv2

    def local_sum(of: Float) -> Float:
        return np.asarray(cv2.boxFilter(of, -1, (_LIGHT_PX,) * 2, normalize=False, borderType=0), np.float64)

    weight = region.astype(np.float64)
    light = local_sum(grey * weight) / np.maximum(local_sum(weight), 1.0)
    return (grey - light) * weight


def autocovariance(pattern: Float, region: Mask, noise: float, axis: int) -> Float:
    """Return the autocovariance (n,) of a pattern along one axis at lags 0, 1, … px, without noise.

    The largest lag is about three times the lag at which the autocovariance has fallen to a half, but at most
    half of the image.

    `pattern`, shape (height, width): grey levels from `even_light`. `noise`: standard deviation of the white
    noise, grey levels; its variance is subtracted at lag 0. `axis`: 0 for lags along y, 1 for lags along x.
    `region` has the shape (height, width).

    Raises `CorrelationError` if the variance of the pattern is not larger than the variance of the noise.
    """
    pattern, region = np.moveaxis(pattern, axis, 0), np.moveaxis(region, axis, 0)
    length = len(pattern)
    values = [float((pattern**2).sum() / region.sum()) - noise**2]
    if values[0] <= noise**2:
        raise CorrelationError(
            "image",
            "look for a pattern",
            "grey levels that differ by more than noise",
            f"a contrast of {max(values[0], 0.0) ** 0.5:.1f} at a noise of {noise:.1f} grey levels",
            "check light, focus and the region, or apply a pattern",
        )
    end = length // 2
    for lag in range(1, length // 2):
        pairs = np.count_nonzero(region[lag:] & region[:-lag])
        if lag > end or pairs == 0:
            break
        values.append(float(np.einsum("ij,ij->", pattern[lag:], pattern[:-lag])) / pairs)
        if values[-1] < values[0] / 2 and end == length // 2:
            end = 3 * lag + 3
    return np.array(values)


def speckle_size(covariance: Float) -> float:
    """Return the full width at half maximum of an autocovariance, in px.

    For Gaussian blobs of standard deviation s the result is 4 √(ln 2) s = 3.33 s; for sharp dots of diameter
    D it is 0.81 D. The result is infinite if the autocovariance does not fall to a half.

    `covariance`, shape (n,): autocovariance at lags 0, 1, … px.
    """
    from scipy.interpolate import CubicSpline

    below = np.flatnonzero(covariance < covariance[0] / 2)
    if not below.size:
        return float("inf")
    lags = np.arange(1 - covariance.size, covariance.size)
    curve = CubicSpline(lags, np.concatenate([covariance[:0:-1], covariance]) - covariance[0] / 2)
    crossings = curve.roots(extrapolate=False)
    return 2.0 * float(crossings[crossings > 0.0].min())


def edge_blur(grey: Grey, region: Mask, noise: float) -> float:
    """Return the standard deviation of the blur at the sharpest edges, px.

    The function blurs the image by two known amounts and compares the grey level gradients at edges. The more
    an edge is already blurred, the less its gradient changes by further blur. The method follows S. Zhuo, T.
    Sim, "Defocus map estimation from a single image", Pattern Recognition 44 (2011) 1852-1858. Unlike that
    paper, the function applies two blurs instead of one, to reduce the influence of noise. The finite size of
    the pixels alone causes a blur of 0.29 px. If the speckles are less than five times as wide as their blur,
    the result is too small.

    `noise`: standard deviation of the image's white noise, grey levels. `region` has the shape (height,
    width).

    Result: the blur; NaN if there are too few edges.
    """
    coarse, coarse_noise = _squared_slopes(grey, _COARSE_PX)
    fine, fine_noise = _squared_slopes(grey, _FINE_PX)
    # At the border of the region, large gradients may belong to the outline of the specimen.
    inner = _shrunk(region, 8)
    if np.count_nonzero(inner) * _EDGES < _FEWEST_EDGES:
        return float("nan")
    edges = inner & (coarse >= np.percentile(coarse[inner], 100 * (1 - _EDGES)))
    steep = float(fine[edges].mean()) - fine_noise * noise**2
    less = float(coarse[edges].mean()) - coarse_noise * noise**2
    if less <= 0.0 or steep <= less:
        return float("nan")
    ratio = steep / less
    return float(np.sqrt(max(0.0, (_COARSE_PX**2 - ratio * _FINE_PX**2) / (ratio - 1.0))))


def _shrunk(region: Mask, by_px: int) -> Mask:
    import cv2

    size = 2 * by_px + 1
    return np.asarray(cv2.erode(region.astype(np.uint8), np.ones((size, size), np.uint8)), np.bool_)


def _squared_slopes(grey: Grey, blur_px: float) -> tuple[Float, float]:
    """Return the squared gradient of a blurred image, and the value that white noise alone would give.

    The blur is Gaussian with the standard deviation `blur_px`. The value for noise is the mean squared
    gradient of blurred white noise of variance 1.
    """
    from scipy.ndimage import gaussian_filter

    def squared(image: Grey) -> Float:
        along = [gaussian_filter(image, blur_px, order=order) for order in ((0, 1), (1, 0))]
        return np.asarray(along[0] ** 2 + along[1] ** 2, np.float64)

    side = 2 * int(4 * blur_px + 1) + 1
    impulse = np.zeros((side, side), np.float32)
    impulse[side // 2, side // 2] = 1.0
    return squared(grey), float(squared(impulse).sum())
