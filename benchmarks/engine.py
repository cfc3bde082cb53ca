"""Our engine in the three ways in which its speed is measured."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import Stopwatch
from dic import kernel
from dic.correlate import Correlator
from dic.field import Field, Status
from dic.settings import CorrelationSettings
from dic.spline import halfway_noise_gain, spline_image

Grey = NDArray[np.float32]
Float = NDArray[np.float64]


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
    """IC-GN at given points from the truth rounded to whole pixels, the images already prepared.

    Parameters
    ----------
    reference, deformed : ndarray of float32, shape (height, width)
    settings : CorrelationSettings
    points : ndarray of int, shape (n, 2)
        As (x, y).
    start : ndarray, shape (n, 2)
        Displacements to start from, px.
    """

    def __init__(
        self,
        reference: Grey,
        deformed: Grey,
        settings: CorrelationSettings,
        points: NDArray[np.int64],
        start: Float,
    ) -> None:
        spline, mean = spline_image(reference, settings.order), float(reference.mean())
        everywhere = np.ones(reference.shape, np.bool_)
        self._reference = kernel.lay_reference(spline, spline.gradient(), everywhere, mean)
        self._coefficients = kernel.lay_coefficients(spline_image(deformed, settings.order), mean)
        self._settings, self._points, self._start = settings, points, start
        self._limits = kernel.Limits(
            settings.radius_px, settings.min_zncc, settings.tolerance_px, settings.max_iterations,
            halfway_noise_gain(settings.order),
        )  # fmt: skip

    def time(self, threads: int) -> tuple[Timing, float]:
        """Return the speed, and how many iterations a point took on average.

        Raises
        ------
        RuntimeError
            If a point did not converge: its time would say nothing.
        """
        n = len(self._points)
        warps = np.zeros((n, self._settings.parameters))
        warps[:, 0], warps[:, 3] = self._start.T
        deviations, status = np.empty((n, 6)), np.empty(n, np.int8)
        zncc, iterations = np.empty(n), np.empty(n, np.int16)
        pixels = np.full(n, self._settings.subset_px**2)

        def work(part: slice) -> None:
            kernel.correlate_points(
                self._reference, self._coefficients, (0.0,) * (self._settings.order + 1),
                (0.0,) * self._settings.parameters, self._limits, self._points[part], pixels[part],
                warps[part], deviations[part], status[part], zncc[part], iterations[part],
            )  # fmt: skip

        edges = np.linspace(0, n, threads + 1).astype(int)
        parts = [slice(first, last) for first, last in itertools.pairwise(edges)]
        with Stopwatch() as watch, ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, parts))
        if (status != Status.CONVERGED).any():
            raise RuntimeError(f"{np.count_nonzero(status != Status.CONVERGED)} of {n} points failed")
        return _timing(n, watch), float(iterations.mean())
