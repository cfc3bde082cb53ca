"""Make displacement fields with exactly known displacements, without correlation of images."""

from dataclasses import replace

import numpy as np

from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from dic.strain.measurement import measure
from dic.strain.settings import StrainSettings

SHAPE = (400, 300)


def exact_field(moved, *, step_px=10, subset_px=21, std_px=0.01, lost=(), shape="affine"):
    """Return the field of the displacement `moved(x, y)` → (u, v) in px; the points in `lost` failed."""
    x_px, y_px = np.arange(20, SHAPE[1] - 20, step_px), np.arange(20, SHAPE[0] - 20, step_px)
    x, y = np.meshgrid(x_px.astype(float), y_px.astype(float))
    warps = np.zeros((*x.shape, 6))
    warps[..., 0], warps[..., 3] = moved(x, y)
    status = np.full(x.shape, Status.CONVERGED, np.int8)
    for row, column in lost:
        status[row, column] = Status.NOT_CONVERGED
        warps[row, column] = np.nan
    return Field(
        x_px=x_px,
        y_px=y_px,
        warps=warps,
        std=np.full((*x.shape, 6), std_px),
        zncc=np.ones(x.shape),
        iterations=np.ones(x.shape, np.int16),
        status=status,
        active=np.ones(x.shape, bool),
        start="search",
        settings=CorrelationSettings(subset_px=subset_px, step_px=step_px, shape=shape),
    )


def exact_series(*fields, calibration=None, measure_of_strain="green-lagrange"):
    """Return a measured series whose images have the given fields."""
    how = StrainSettings(measure=measure_of_strain)
    images = [
        MeasuredImage(f"image {k}", measure(field, calibration, how, label=f"image {k}"))
        for k, field in enumerate(fields)
    ]
    return MeasuredSeries(np.zeros(SHAPE, np.float32), images)


def stretched(F, shift=(3.3, -2.1)):
    """Return the displacement function of a deformation gradient `F` (y up) about the image's middle."""
    G = np.diag([1.0, -1.0]) @ (np.asarray(F) - np.eye(2)) @ np.diag([1.0, -1.0])

    def moved(x, y):
        dx, dy = x - SHAPE[1] / 2, y - SHAPE[0] / 2
        return shift[0] + G[0, 0] * dx + G[0, 1] * dy, shift[1] + G[1, 0] * dx + G[1, 1] * dy

    return moved


def with_noise(field, rng, std_px):
    """Return the field with independent random errors added to its displacements."""
    warps = field.warps.copy()
    for k in (0, 3):
        warps[..., k] += rng.normal(0.0, std_px, warps.shape[:2])
    return replace(field, warps=warps)
