"""What displacements an image can resolve, before anything is correlated.

Noise of standard deviation σ in both images spreads a displacement by √2 σ / √SSSIG, with the sum of squared
subset intensity gradients: B. Pan, H. Xie, Z. Wang, K. Qian, Z. Wang, "Study on subset size selection in
digital image correlation for speckle patterns", Optics Express 16 (2008) 7037-7048. The other parameters of
the shape function and the noise in the gradients themselves add to that; here both are counted.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dic.correlation.settings import CorrelationSettings
from dic.image.spline import SplineImage, slope_noise_gain

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

_POINTS = 150
_WIDEST_PX = 151
_LEAST_SHARE = 0.5


def sample_points(centres: Mask, subset_px: int) -> NDArray[np.int64]:
    """Return points (n, 2) as (x, y), spread over the `centres` whose subset stays in the image."""
    r, (height, width) = subset_px // 2, centres.shape
    allowed = np.zeros_like(centres)
    allowed[r : height - r, r : width - r] = centres[r : height - r, r : width - r]
    step = max(1, int(np.sqrt(np.count_nonzero(allowed) / _POINTS)))
    rows, columns = np.nonzero(allowed[step // 2 :: step, step // 2 :: step])
    return np.stack([columns, rows], axis=1) * step + step // 2


def squared_gradients(spline: SplineImage, points: NDArray[np.int64], region: Mask, subset_px: int) -> Float:
    """Return the sums of squared gradients along x and y, (n, 2), at `points`, noise included."""
    pieces = _pieces([*spline.gradient(), region], points, subset_px)
    return np.array([[(use * fx**2).sum(), (use * fy**2).sum()] for fx, fy, use in pieces])


def predicted_std(
    spline: SplineImage,
    noise: float,
    points: NDArray[np.int64],
    region: Mask,
    settings: CorrelationSettings,
) -> Float:
    """Return the standard deviations of u and v, px, that noise causes at points: the noise floor.

    The covariance of IC-GN's parameters is σ² (H⁻¹ + H⁻¹ Ĥ H⁻¹), with the Hessian Ĥ of the normalised
    criterion as the noisy gradients make it, and H as it were without their noise. The first term is due to
    the reference, whose noise its own gradients do not see, being odd; the second to the deformed image.

    Parameters
    ----------
    spline : SplineImage
        The reference.
    noise : float
        Standard deviation of the white noise of an image, grey levels.
    points : ndarray of int, shape (n, 2)
        (x, y), a whole subset away from the image's edge.
    region : ndarray of bool, shape (height, width)
        Pixels that subsets may use.
    settings : CorrelationSettings
        For subset and shape function.

    Returns
    -------
    ndarray, shape (n, 2)
        Infinite where there is no texture.
    """
    terms, k = _terms(settings), settings.parameters // 2
    gradient_noise = noise**2 * slope_noise_gain(settings.order)
    deviations = np.full((len(points), 2), np.inf)
    planes = [spline.grey, *spline.gradient(), region]
    for n, (f, fx, fy, use) in enumerate(_pieces(planes, points, settings.subset_px)):
        inside = use.ravel().astype(np.bool_)
        M = terms[inside]
        J = np.hstack([plane.ravel()[inside, None] * M for plane in (fx, fy)])
        f = f.ravel()[inside] - f.ravel()[inside].mean()
        if np.count_nonzero(inside) < _LEAST_SHARE * inside.size or not f.any():
            continue
        s, t = J.sum(axis=0), f @ J
        noisy = J.T @ J - np.outer(s, s) / len(f) - np.outer(t, t) / (f @ f)
        true = noisy - gradient_noise * np.kron(np.eye(2), M.T @ M)
        if np.linalg.eigvalsh(true)[0] > 0.0:
            inverse = np.linalg.inv(true)
            variances = noise**2 * np.diag(inverse + inverse @ noisy @ inverse)
            deviations[n] = np.sqrt(variances[[0, k]])
    return deviations


def noise_floor(std_px: Float, share: float) -> float:
    """Return the standard deviation, px, that a share of the points keep, the worse of u and v.

    Parameters
    ----------
    std_px : ndarray, shape (n, 2)
        From `predicted_std`.
    share : float
        Of all points, those without texture included.
    """
    return float(np.percentile(std_px.max(axis=1), 100 * share, method="higher"))


def smallest_subset(
    spline: SplineImage,
    noise: float,
    centres: Mask,
    region: Mask,
    settings: CorrelationSettings,
    wanted_px: float,
    share: float,
) -> int | None:
    """Return the smallest odd subset whose `noise_floor` for this share of points is at most `wanted_px`.

    None if no subset up to 151 px, or up to half of the image, is large enough.
    """
    widest = min(_WIDEST_PX, min(region.shape) // 2)
    sizes = range(7, widest + 1, 2)
    low, high = 0, len(sizes)
    while low < high:
        middle = (low + high) // 2
        chosen = CorrelationSettings(subset_px=sizes[middle], shape=settings.shape, order=settings.order)
        points = sample_points(centres, chosen.subset_px)
        floor = predicted_std(spline, noise, points, region, chosen)
        if len(floor) and noise_floor(floor, share) <= wanted_px:
            high = middle
        else:
            low = middle + 1
    return sizes[low] if low < len(sizes) else None


def _terms(settings: CorrelationSettings) -> Float:
    """Return the shape function's terms at every pixel of a subset, scaled to its radius."""
    r = settings.radius_px
    y, x = (axis.ravel() / r for axis in np.mgrid[-r : r + 1, -r : r + 1])
    terms = [np.ones_like(x), x, y]
    if settings.shape == "quadratic":
        terms += [x * x, x * y, y * y]
    return np.column_stack(terms)


def _pieces(
    planes: list[NDArray[np.generic]], points: NDArray[np.int64], subset_px: int
) -> Iterator[list[Float]]:
    """Yield the subsets of several planes at each point."""
    r = subset_px // 2
    for x, y in points:
        here = (slice(y - r, y + r + 1), slice(x - r, x + r + 1))
        yield [plane[here].astype(np.float64) for plane in planes]
