"""Our engine in the three ways in which its speed is measured."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import Stopwatch
from dic.correlation import kernel
from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.image.spline import halfway_noise_gain, slope_noise_gain, spline_image

Grey = NDArray[np.float32]
Float = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Timing:
    """Points per second of processor time and of time on the wall."""

    per_cpu_s: float
    per_wall_s: float


def _timing(points: int, watch: Stopwatch) -> Timing:
    return Timing(points / watch.cpu_s, points / watch.wall_s)


def time_pair(
    reference: Grey, deformed: Grey, settings: CorrelationSettings, threads: int
) -> tuple[Timing, Field]:
    """Time all that a pair takes: preparing both images, search, propagation, checks."""
    with Stopwatch() as watch:
        field = Correlator(reference, settings=settings, threads=threads).correlate(deformed)
    return _timing(int(field.active.sum()), watch), field


class Series:
    """A series with one reference: what every further image takes.

    Parameters
    ----------
    reference, before : ndarray of float32, shape (height, width)
        `before` is the image before the one that is timed.
    settings : CorrelationSettings
    threads : int
    """

    def __init__(self, reference: Grey, before: Grey, settings: CorrelationSettings, threads: int) -> None:
        self._correlator = Correlator(reference, settings=settings, threads=threads)
        self._previous = self._correlator.correlate(before)

    def time(self, deformed: Grey) -> Timing:
        """Time the next image, which starts from the field before."""
        with Stopwatch() as watch:
            field = self._correlator.correlate(deformed, previous=self._previous)
        return _timing(int(field.active.sum()), watch)


class KernelAlone:
    """IC-GN on a grid, every point from the truth rounded to whole pixels, the images already prepared.

    Parameters
    ----------
    reference, deformed : ndarray of float32, shape (height, width)
    settings : CorrelationSettings
    x_px, y_px : ndarray of int, shapes (columns,) and (rows,)
        Coordinates of the grid.
    start : ndarray, shape (rows, columns, 2)
        Displacements to start from, px.
    """

    def __init__(
        self,
        reference: Grey,
        deformed: Grey,
        settings: CorrelationSettings,
        x_px: Indices,
        y_px: Indices,
        start: Float,
    ) -> None:
        spline, mean = spline_image(reference, settings.order), float(reference.mean())
        everywhere = np.ones(reference.shape, np.bool_)
        self._reference = kernel.lay_reference(spline, spline.gradient(), everywhere, mean)
        self._coefficients = kernel.lay_coefficients(spline_image(deformed, settings.order), mean)
        self._settings, self._x, self._y, self._start = settings, x_px, y_px, start
        self._limits = kernel.Limits(
            settings.radius_px, settings.min_zncc, settings.tolerance_px, settings.max_iterations,
            halfway_noise_gain(settings.order),
            slope_noise_gain(settings.order),
        )  # fmt: skip

    def time(self, threads: int) -> tuple[Timing, float]:
        """Return the speed, and how many iterations a point took on average.

        Raises
        ------
        RuntimeError
            If a point did not converge: its time would say nothing.
        """
        grid = self._start.shape[:2]
        warps = np.zeros((*grid, self._settings.parameters))
        warps[..., 0], warps[..., 3] = self._start[..., 0], self._start[..., 1]
        deviations, status = np.empty((*grid, 6)), np.empty(grid, np.int8)
        zncc, iterations = np.empty(grid), np.empty(grid, np.int16)
        pixels, pending = np.full(grid, self._settings.subset_px**2), np.ones(grid, np.bool_)

        def work(rows: slice) -> None:
            kernel.correlate_grid(
                self._reference, self._coefficients, (0.0,) * (self._settings.order + 1),
                (0.0,) * self._settings.parameters, self._limits, self._x, self._y[rows], pixels[rows],
                np.argwhere(pending[rows]), warps[rows], deviations[rows], status[rows], zncc[rows],
                iterations[rows], pending[rows], False,
            )  # fmt: skip

        edges = np.linspace(0, grid[0], threads + 1).astype(int)
        bands = [slice(first, last) for first, last in itertools.pairwise(edges)]
        with Stopwatch() as watch, ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, bands))
        if (failed := np.count_nonzero(status != Status.CONVERGED)) > 0:
            raise RuntimeError(f"{failed} of {status.size} points failed")
        return _timing(status.size, watch), float(iterations.mean())
