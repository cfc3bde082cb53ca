"""The accuracy of the best possible correlation, computed from the pattern alone.

This module uses no code of the tested correlation. The derivatives are differences of images drawn by
formulas. The bounds follow from least squares. The transfer function of a subset is that of a polynomial fit.
"""

from functools import cache

import numpy as np
from scipy.optimize import brentq

from benchmarks.speckle import Speckle, shift
from dic.typing import Float, Indices

_H = 0.02


@cache
def slopes(speckle: Speckle) -> tuple[Float, Float]:
    """Return the derivatives of the noiseless picture along x and y, grey levels per pixel.

    The function takes central differences of images that are shifted by ±0.02 px. The error is below 1e-4 of
    the slope.
    """
    along_x = (speckle.draw(shift(-_H, 0)) - speckle.draw(shift(_H, 0))) / (2 * _H)
    along_y = (speckle.draw(shift(0, -_H)) - speckle.draw(shift(0, _H))) / (2 * _H)
    return along_x, along_y


def cramer_rao_px(
    picture: Float, gradient: tuple[Float, Float], points: Indices, subset_px: int, shape: str
) -> Float:
    """Return the smallest possible standard deviations of u and v per grey level of noise, (n, 2).

    This is the Cramér-Rao bound. Both images have independent white noise with the variance σ², so their
    difference has the variance 2σ². The unknowns are all parameters of the shape function, and gain and
    offset of the grey levels. The matrix J has a column of derivatives for each unknown. The squared bounds
    are the diagonal elements of 2σ² (J'J)⁻¹ that belong to u and v.

    Parameters
    ----------
    picture : ndarray, shape (height, width)
        Noiseless reference.
    gradient : tuple of ndarray
        Derivatives of `picture` along x and y.
    points : ndarray of int, shape (n, 2)
        Coordinates (x, y) of the points.
    subset_px : int
    shape : str
        "affine" or "quadratic".
    """
    r = subset_px // 2
    y, x = np.mgrid[-r : r + 1, -r : r + 1].reshape(2, -1) / r
    terms = [np.ones_like(x), x, y]
    if shape == "quadratic":
        terms += [x * x, x * y, y * y]
    bounds = np.empty((len(points), 2))
    for k, (px, py) in enumerate(points):
        here = np.s_[py - r : py + r + 1, px - r : px + r + 1]
        f, fx, fy = (a[here].ravel() for a in (picture, *gradient))
        design = np.stack([*(fx * t for t in terms), *(fy * t for t in terms), np.ones_like(f), f], axis=1)
        variances = 2 * np.diag(np.linalg.inv(design.T @ design))
        bounds[k] = np.sqrt(variances[[0, len(terms)]])
    return bounds


def transfer(subset_px: int, shape: str, period_px: float) -> float:
    """Return the share of its amplitude that a cosine displacement keeps in the measurement by a subset.

    The displacement of a subset is the value at its middle of the polynomial that fits the true displacement
    best: the mean for affine shape functions, the parabola of Savitzky and Golay (Analytical Chemistry 36
    (1964) 1627-1639) for quadratic ones.
    """
    offset = np.arange(subset_px) - subset_px // 2
    powers = (0, 1) if shape == "affine" else (0, 1, 2)
    design = np.stack([(offset / subset_px) ** p for p in powers], axis=1)
    return float(np.linalg.pinv(design)[0] @ np.cos(2 * np.pi * offset / period_px))


def resolution_px(subset_px: int, shape: str, share: float = 0.9) -> float:
    """Return the period, px, of the cosine displacement that keeps `share` of its amplitude in a subset."""
    return float(brentq(lambda p: transfer(subset_px, shape, p) - share, subset_px, 20 * subset_px))
