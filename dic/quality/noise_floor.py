"""The noise floor: the standard deviation of displacements that image noise causes, predicted from one image.

White noise of standard deviation σ in both images gives the displacement of a subset a standard deviation of
√2 σ / √SSSIG. SSSIG is the sum of squared subset intensity gradients: B. Pan, H. Xie, Z. Wang, K. Qian, Z.
Wang, "Study on subset size selection in digital image correlation for speckle patterns", Optics Express 16
(2008) 7037-7048. Two effects make the standard deviation larger than this value: the fit of further
parameters of the shape function, and the noise of the gradients. This module includes both effects.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dic.correlation.settings import CorrelationSettings
from dic.correlation.smoothing import NO_SMOOTHING, Smoothing
from dic.image.spline import SplineImage, slope_noise_gain
from dic.typing import Float, Indices, Mask

_POINTS = 150
_WIDEST_PX = 151
LEAST_SHARE = 0.5
"""Smallest share of a subset's pixels that must lie in the region of interest."""


def sample_points(centres: Mask, subset_px: int) -> Indices:
    """Return about 150 points, shape (n, 2), spread evenly over the mask `centres`.

    The subset of every point lies completely within the image.
    """
    r, (height, width) = subset_px // 2, centres.shape
    allowed = np.zeros_like(centres)
    allowed[r : height - r, r : width - r] = centres[r : height - r, r : width - r]
    step = max(1, int(np.sqrt(np.count_nonzero(allowed) / _POINTS)))
    rows, columns = np.nonzero(allowed[step // 2 :: step, step // 2 :: step])
    return np.stack([columns, rows], axis=1) * step + step // 2


def squared_gradients(spline: SplineImage, points: Indices, region: Mask, subset_px: int) -> Float:
    """Return the sums of squared grey level gradients along x and y in each subset, shape (n, 2).

    The sums include the gradients that noise causes.
    """
    subsets = _subsets([*spline.gradient(), region], points, subset_px)
    return np.array([[(use * fx**2).sum(), (use * fy**2).sum()] for fx, fy, use in subsets])


def predicted_std(
    spline: SplineImage,
    noise: float,
    points: Indices,
    region: Mask,
    settings: CorrelationSettings,
    smoothing: Smoothing = NO_SMOOTHING,
) -> Float:
    """Return the noise floor at points: the standard deviations of u and v, px, that image noise causes.

    The correlation (IC-GN, inverse compositional Gauss-Newton) fits the parameters of the shape function.
    Noise of standard deviation σ gives these parameters the covariance σ² (H⁻¹ + H⁻¹ Ĥ H⁻¹). The matrix Ĥ is
    the Hessian of the normalised criterion, computed from the noisy gradients; H is the same Hessian without
    the noise of the gradients. The term H⁻¹ Ĥ H⁻¹ comes from the noise of the deformed image. The term H⁻¹
    comes from the noise of the reference image. The term H⁻¹ does not contain Ĥ, because the gradient at a
    pixel does not depend on the noise of the same pixel (derivative filters are odd).

    Parameters
    ----------
    spline : SplineImage
        The reference image, after smoothing.
    noise : float
        Standard deviation of the white noise of one image before smoothing, grey levels.
    points : ndarray of int, shape (n, 2)
        Coordinates x and y of the points; the subset of each point must lie within the image.
    region : ndarray of bool, shape (height, width)
        Pixels that subsets may use.
    settings : CorrelationSettings
        Settings of the correlation; the function uses the subset, the shape function and the spline order.
    smoothing : Smoothing
        The filter that smooths both images. Default: no smoothing.

    Returns
    -------
    ndarray, shape (n, 2)
        Standard deviations of u and v at each point; infinite where there is no texture, or where less than
        half of the subset is in the region.
    """
    terms, k = _terms(settings), settings.parameters // 2
    count = terms.shape[1]
    # Sums over products of two terms, as one matrix product for each subset
    products = (terms[:, :, None] * terms[:, None, :]).reshape(len(terms), -1)
    noise = noise * smoothing.noise_factor
    gradient_noise = noise**2 * slope_noise_gain(settings.order, smoothing.taps)
    std_px = np.full((len(points), 2), np.inf)
    planes = [spline.grey, *spline.gradient(), region]
    for n, subset in enumerate(_subsets(planes, points, settings.subset_px)):
        f, fx, fy, use = (plane.ravel() for plane in subset)
        pixels = use.sum()
        if pixels < LEAST_SHARE * use.size:
            continue
        f = (f - f @ use / pixels) * use
        if not f.any():
            continue
        fx, fy = fx * use, fy * use
        xx, xy, yy, plain = (np.stack([fx * fx, fx * fy, fy * fy, use]) @ products).reshape(-1, count, count)
        s, t = (np.stack([fx, fy, f * fx, f * fy]) @ terms).reshape(2, -1)
        hessian = np.block([[xx, xy], [xy, yy]])
        noisy = hessian - np.outer(s, s) / pixels - np.outer(t, t) / (f @ f)
        true = noisy - gradient_noise * np.kron(np.eye(2), plain)
        if np.linalg.eigvalsh(true)[0] > 0.0:
            inverse = np.linalg.inv(true)
            variances = noise**2 * np.diag(inverse + inverse @ noisy @ inverse)
            std_px[n] = np.sqrt(variances[[0, k]]) * smoothing.std_factors
    return std_px


def noise_floor(std_px: Float, share: float) -> float:
    """Return the value, px, that the standard deviations of u and v do not exceed at a share of the points.

    `std_px`, shape (n, 2): standard deviations from `predicted_std`. `share`: share of the points, from 0 to
    1, relative to all points. Points without texture are counted too.
    """
    return float(np.percentile(std_px.max(axis=1), 100 * share, method="higher"))


def smallest_subset(
    spline: SplineImage,
    noise: float,
    centres: Mask,
    region: Mask,
    settings: CorrelationSettings,
    smoothing: Smoothing,
    wanted_px: float,
    share: float,
) -> int | None:
    """Return the width, px, of the smallest odd subset whose `noise_floor` is at most `wanted_px`.

    The argument `share` is passed to `noise_floor`. The mask `centres` is True at pixels that may be points
    of interest. The function returns None if no tried subset is large enough. The function tries widths up to
    151 px, but at most half of the image.
    """
    widest = min(_WIDEST_PX, min(region.shape) // 2)
    sizes = range(7, widest + 1, 2)
    low, high = 0, len(sizes)
    while low < high:
        middle = (low + high) // 2
        chosen = CorrelationSettings(subset_px=sizes[middle], shape=settings.shape, order=settings.order)
        points = sample_points(centres, chosen.subset_px)
        floor = predicted_std(spline, noise, points, region, chosen, smoothing)
        if len(floor) and noise_floor(floor, share) <= wanted_px:
            high = middle
        else:
            low = middle + 1
    return sizes[low] if low < len(sizes) else None


def _terms(settings: CorrelationSettings) -> Float:
    """Return the terms of the shape function at every pixel of a subset, shape (pixels, terms).

    The pixel coordinates are scaled so that the border of the subset is at ±1.
    """
    r = settings.radius_px
    y, x = (axis.ravel() / r for axis in np.mgrid[-r : r + 1, -r : r + 1])
    terms = [np.ones_like(x), x, y]
    if settings.shape == "quadratic":
        terms += [x * x, x * y, y * y]
    return np.column_stack(terms)


def _subsets(planes: list[NDArray[np.generic]], points: Indices, subset_px: int) -> Iterator[list[Float]]:
    """Yield, for each point, those elements of every given array that lie in the point's subset.

    Each array of values has the shape (subset_px, subset_px).
    """
    r = subset_px // 2
    for x, y in points:
        here = (slice(y - r, y + r + 1), slice(x - r, x + r + 1))
        yield [plane[here].astype(np.float64) for plane in planes]
