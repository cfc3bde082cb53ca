"""The correlation of `dic`, timed in three ways: a pair of images, an image of a series, the kernel alone."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.machine import Stopwatch
from dic.correlation import kernel
from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.solver import method_of
from dic.image.spline import spline_image
from dic.image.stored import StoredImage
from dic.typing import Float, Grey, Indices


@dataclass(frozen=True)
class Timing:
    """Speed: points per second of processor time, and points per second of elapsed time."""

    per_cpu_s: float
    per_wall_s: float


def _timing(points: int, watch: Stopwatch) -> Timing:
    return Timing(points / watch.cpu_s, points / watch.wall_s)


def time_pair(
    reference: Grey, deformed: Grey, settings: CorrelationSettings, threads: int
) -> tuple[Timing, Field]:
    """Time all steps for a pair of images: preparation of both images, search, propagation and checks."""
    with Stopwatch() as watch:
        field = Correlator(reference, settings=settings, threads=threads).correlate(deformed)
    return _timing(int(field.active.sum()), watch), field


class Series:
    """A series with one reference, to time one further image of the series.

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
        """Time the correlation of the next image, which starts from the field of the image `before`."""
        with Stopwatch() as watch:
            field = self._correlator.correlate(deformed, previous=self._previous)
        return _timing(int(field.active.sum()), watch)


class KernelAlone:
    """IC-GN alone, on prepared images: every point starts from its true displacement in whole pixels.

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
        self._reference = kernel.lay_reference(spline, everywhere, mean)
        self._deformed = kernel.lay_deformed(StoredImage(deformed), settings.order, mean)
        self._settings, self._method = settings, method_of(settings)
        self._x, self._y, self._start = x_px, y_px, start

    def time(self, threads: int) -> tuple[Timing, float]:
        """Return the speed, and the mean number of iterations of a point.

        Raises
        ------
        RuntimeError
            If a point did not converge, because its time would be meaningless.
        """
        shape = self._start.shape[:2]
        solution = kernel.Solution.empty(shape, self._settings.parameters)
        solution.warps[..., [0, 3]] = self._start
        pixels = np.full(shape, self._settings.subset_px**2)

        def work(rows: slice) -> None:
            grid, seeds = kernel.KernelGrid(self._x, self._y[rows], pixels[rows]), np.argwhere(pixels[rows])
            kernel.correlate_seeds(
                self._reference, self._deformed, self._method, grid, seeds, solution.part(rows)
            )

        edges = np.linspace(0, shape[0], threads + 1).astype(int)
        bands = [slice(first, last) for first, last in itertools.pairwise(edges)]
        with Stopwatch() as watch, ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, bands))
        if (failed := np.count_nonzero(~solution.converged)) > 0:
            raise RuntimeError(f"{failed} of {pixels.size} points failed")
        return _timing(pixels.size, watch), float(solution.iterations.mean())
