"""Computes local strain in complete strain windows, and its noise relative to the displacement noise.

On a complete window of a regular grid, the fitted slope is a sum of displacements with fixed weights. Each
weight is the weight of a slope along one axis times the weight of a mean along the other (A. Savitzky, M. J.
E. Golay, Analytical Chemistry 36 (1964) 1627-1639). A study computes strain for many settings, so it uses
these weights instead of a fit in each window.
"""

from functools import cache

import numpy as np

from dic.correlation.settings import CorrelationSettings
from dic.strain.displacement import Displacement, Noise
from dic.strain.error_overlap import error_overlap
from dic.strain.fit import fitted_gradients
from dic.strain.settings import StrainSettings
from dic.strain.tensor import strain_of
from dic.typing import Float


def window_strain(u_px: Float, v_px: Float, step_px: int, strain: StrainSettings) -> Float:
    """Return the strains exx and eyy, shape (2, rows, columns), from displacements on a regular grid.

    `u_px`, `v_px`, shape (rows, columns): displacements; NaN where they are not known. `step_px`: spacing of
    the points. `strain`: window and measure of the strain; the source must be "fit".

    Result, shape (2, rows, columns): the strains exx and eyy; NaN at points whose window is not complete.
    """
    gradient = np.full((*u_px.shape, 2, 2), np.nan)
    window = strain.window_points
    rows, columns = (slice(window // 2, n - window // 2) for n in u_px.shape)
    if min(u_px.shape) >= window:
        for i, component in enumerate((u_px, v_px)):
            for j, axis in enumerate((1, 0)):
                gradient[rows, columns, i, j] = _slope(component, axis, window) / step_px
    return strain_of(gradient, None, strain.measure)[0][:2]


def _slope(values: Float, axis: int, window: int) -> Float:
    """Return the slope along `axis`, per point, of the plane fitted in each complete window."""
    offset = np.arange(window) - window // 2
    parts = np.lib.stride_tricks.sliding_window_view(values, window, axis=axis)
    slopes = parts @ (offset / (offset @ offset))
    across = np.lib.stride_tricks.sliding_window_view(slopes, window, axis=1 - axis)
    return np.asarray(across.mean(axis=-1))


@cache
def noise_factor_per_px(correlation: CorrelationSettings, strain: StrainSettings) -> float:
    """Return the standard deviation of exx in a complete window divided by that of u, 1/px.

    The factor contains the correlation between the errors of overlapping subsets.
    """
    window, step = strain.window_points, correlation.step_px
    y, x = np.mgrid[:window, :window] * float(step)
    everywhere = np.ones((window, window), np.bool_)
    unit = np.broadcast_to(np.eye(2), (window, window, 2, 2))
    unknown = np.full((window, window, 4, 4), np.nan)
    noise = Noise(unit, error_overlap(correlation), unknown)
    position = np.stack([x, y], axis=-1)
    points = Displacement(position, np.zeros_like(position), everywhere, "px", noise=noise)
    _, covariance = fitted_gradients(points, window, 1)
    assert covariance is not None
    return float(np.sqrt(covariance[window // 2, window // 2, 0, 0]))
