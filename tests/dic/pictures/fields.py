"""Make displacement fields with exactly known displacements, without correlation of images."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import dic

SHAPE = (240, 300)


def field_of(
    motion: Callable[[np.ndarray], np.ndarray], gradient: np.ndarray, lost: tuple = ()
) -> dic.correlation.Field:
    """Return a field whose points have the displacements of the function `motion`.

    Parameters
    ----------
    motion : function
        Function that returns displacements (u, v) at positions (x, y); both arrays have the shape (…, 2), px.
    gradient : ndarray, shape (2, 2)
        Gradient of the displacement, the same at all points.
    lost : sequence of (row, column)
        Points that failed.
    """
    x, y = np.arange(40, 261, 20), np.arange(30, 211, 20)
    places = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
    shape = places.shape[:2]
    warps = np.empty((*shape, 6))
    warps[..., [0, 3]] = motion(places)
    warps[..., [1, 2, 4, 5]] = gradient.ravel()
    status = np.full(shape, dic.correlation.Status.CONVERGED, np.int8)
    for place in lost:
        warps[place] = np.nan
        status[place] = dic.correlation.Status.LOW_CORRELATION
    settings = dic.CorrelationSettings(subset_px=21, step_px=20)
    few, one = np.full((*shape, 6), 1e-4), np.ones(shape)
    active = np.ones(shape, bool)
    return dic.correlation.Field(
        x, y, warps, few, one, np.full(shape, 3, np.int16), status, active, "search", settings
    )


def stretched(exx: float, lost: tuple = ()) -> dic.correlation.Field:
    """Return the field of a specimen that is stretched to the right by `exx`, with u = 0 at x = 0."""
    gradient = np.array([[exx, 0.0], [0.0, 0.0]])
    return field_of(lambda places: places @ gradient.T, gradient, lost)


def part_of(field: dic.correlation.Field, rows: slice, columns: slice) -> dic.correlation.Field:
    """Return the field of some rows and columns of points."""
    names = "warps", "std", "zncc", "iterations", "status", "active"
    parts = {name: getattr(field, name)[rows, columns] for name in names}
    return replace(field, x_px=field.x_px[columns], y_px=field.y_px[rows], **parts)
