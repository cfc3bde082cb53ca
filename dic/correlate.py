"""Correlate deformed images with their reference: fields of displacements in pixels."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic import kernel
from dic.agreement import agreeing_field, agreeing_seeds
from dic.errors import CorrelationError
from dic.field import Field, Status
from dic.region import checked_region, place_points, textured
from dic.seeds import SEARCH_RADII_PX, feature_motion, homography_warps, search
from dic.settings import CorrelationSettings
from dic.spline import halfway_noise_gain, spline_image

Float = NDArray[np.float64]
Grey = NDArray[np.float32]

SEEDS = 48
"""Points tried first; propagation starts from those that converge."""

_FEWEST_SEEDS = 3
_ENOUGH_SEEDS = 0.3
"""Share of the seeds in view that must converge before a way of guessing is believed."""


class Solution(NamedTuple):
    """What IC-GN found on the grid, in the order in which the kernel takes it."""

    warps: Float
    deviations: Float
    status: NDArray[np.int8]
    zncc: Float
    iterations: NDArray[np.int16]

    @classmethod
    def empty(cls, shape: tuple[int, ...], parameters: int) -> "Solution":
        """Return a solution of so many points that knows nothing yet."""
        return cls(
            np.zeros((*shape, parameters)),
            np.full((*shape, 6), np.nan),
            np.full(shape, Status.NOT_REACHED, np.int8),
            np.full(shape, np.nan),
            np.zeros(shape, np.int16),
        )

    def rows(self, part: slice) -> "Solution":
        """Return a view of some rows."""
        return Solution(
            self.warps[part], self.deviations[part], self.status[part], self.zncc[part], self.iterations[part]
        )


class Correlator:
    """Correlates a series with one reference, whose preparation is done once.

    Parameters
    ----------
    reference : ndarray of float32, shape (height, width)
        Grey levels.
    region : ndarray of bool, shape (height, width), optional
        Region of interest, where points may lie. Without one, points are put wherever the reference has
        texture.
    settings : CorrelationSettings
    clip : bool
        Whether subsets are clipped at the region's edge, as they must be where the surface ends there.
    threads : int
        How many to work with; 0 for as many as there are processors.

    Raises
    ------
    CorrelationError
        If the region holds no point.
    """

    def __init__(
        self,
        reference: Grey,
        region: NDArray[np.bool_] | None = None,
        settings: CorrelationSettings | None = None,
        *,
        clip: bool = True,
        threads: int = 0,
    ) -> None:
        self.settings = settings or CorrelationSettings()
        _refuse_unusable(reference, "reference image", self.settings.subset_px)
        spline = spline_image(reference, self.settings.order)
        slopes = spline.gradient()
        usable = np.ones(reference.shape, np.bool_)
        if region is None:
            centres = textured(*slopes, self.settings.subset_px)
        else:
            centres = checked_region(region, reference.shape)
            usable = centres if clip else usable
        self._grid = place_points(centres, usable, self.settings.subset_px, self.settings.step_px)
        self._grey, self._usable, self._mean = spline.grey, usable, float(reference.mean())
        self._reference = kernel.lay_reference(spline, slopes, usable, self._mean)
        self._taps = (0.0,) * (self.settings.order + 1)
        self._limits = kernel.Limits(
            self.settings.radius_px,
            self.settings.min_zncc,
            self.settings.tolerance_px,
            self.settings.max_iterations,
            halfway_noise_gain(self.settings.order),
        )
        self._shape = (0.0,) * self.settings.parameters
        self._threads = threads or len(os.sched_getaffinity(0))

    def correlate(self, deformed: Grey, *, previous: Field | None = None, hint: Float | None = None) -> Field:
        """Return the displacement field from the reference to `deformed`.

        Parameters
        ----------
        deformed : ndarray of float32, of the reference's shape
        previous : Field, optional
            The field of the step before, a good start when little happened since.
        hint : ndarray, shape (3, 3), optional
            Expected homography from the reference to the deformed image, from the stage's angle for instance.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or shows nothing of the reference's pattern.
        """
        if deformed.shape != self._grey.shape:
            raise CorrelationError(
                "deformed image",
                "compare with the reference",
                expected=f"{self._grey.shape[1]} x {self._grey.shape[0]} px",
                got=f"{deformed.shape[1]} x {deformed.shape[0]} px",
                remedy="use images of one camera at one format",
            )
        _refuse_unusable(deformed, "deformed image", self.settings.subset_px)
        coefficients = kernel.lay_coefficients(spline_image(deformed, self.settings.order), self._mean)
        start, seeds, warps = self._first_guess(deformed, coefficients, previous, hint)
        return self._propagate(coefficients, start, seeds, warps)

    def _solve(self, coefficients: Grey, seeds: NDArray[np.int64], warps: Float) -> Solution:
        """Return what IC-GN finds at `seeds` (n, 2) from `warps` (n, 6), as an otherwise empty grid.

        A warp with NaN is no guess: its point stays "not reached".
        """
        solution = Solution.empty(self._grid.active.shape, self.settings.parameters)
        known = np.isfinite(warps).all(axis=1)
        seeds = np.ascontiguousarray(seeds[known])
        rows, columns = seeds.T
        solution.warps[rows, columns, :6] = warps[known]
        self._run(coefficients, solution, self._grid.active.copy(), seeds, (0, len(self._grid.y)))
        return solution

    def _run(
        self,
        coefficients: Grey,
        solution: Solution,
        pending: NDArray[np.bool_],
        seeds: NDArray[np.int64],
        rows: tuple[int, int],
        *,
        spread: bool = False,
    ) -> None:
        """Let the kernel work on some rows of the grid."""
        part = slice(*rows)
        kernel.correlate_grid(
            self._reference, coefficients, self._taps, self._shape, self._limits,
            self._grid.x, self._grid.y[part], self._grid.pixels[part], seeds,
            *solution.rows(part), pending[part], spread,
        )  # fmt: skip

    def _seed_indices(self) -> NDArray[np.int64]:
        """Return up to `SEEDS` grid indices (row, column) spread over the active points."""
        rows, columns = np.nonzero(self._grid.active)
        stride = max(1, round(np.sqrt(rows.size / SEEDS)))
        while True:
            chosen = (rows % stride == stride // 2) & (columns % stride == stride // 2)
            if chosen.sum() >= min(SEEDS // 2, rows.size) or stride == 1:
                return np.stack([rows[chosen], columns[chosen]], axis=1)
            stride -= 1

    def _guesses(
        self, deformed: Grey, indices: NDArray[np.int64], previous: Field | None, hint: Float | None
    ) -> Iterator[tuple[str, Float]]:
        """Yield named guesses at the seeds, the cheapest and most likely first."""
        points = self._points_at(indices)
        half = max(self.settings.radius_px, 15)
        if hint is not None:
            for radius in SEARCH_RADII_PX:
                yield "hint", search(self._grey, deformed, points, half, radius, hint)
        if previous is not None:
            yield "previous", previous.warps[indices[:, 0], indices[:, 1], :6]
        for radius in SEARCH_RADII_PX[:2]:
            yield "search", search(self._grey, deformed, points, half, radius, np.eye(3))
        motion = feature_motion(self._grey, deformed, self._usable)
        if motion is not None:
            yield "features", homography_warps(motion, points.astype(np.float64))
        yield "search", search(self._grey, deformed, points, half, SEARCH_RADII_PX[2], np.eye(3))

    def _points_at(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.stack([self._grid.x[indices[:, 1]], self._grid.y[indices[:, 0]]], axis=1)

    def _first_guess(
        self, deformed: Grey, coefficients: Grey, previous: Field | None, hint: Float | None
    ) -> tuple[str, NDArray[np.int64], Float]:
        """Return the name of the guess that worked, and the seeds (row, column) with their solved warps."""
        indices = self._seed_indices()
        points = self._points_at(indices)
        best: tuple[int, str, NDArray[np.int64], Float] = (0, "", indices[:0], np.empty((0, 6)))
        fewest = min(_FEWEST_SEEDS, len(points))
        for name, guess in self._guesses(deformed, indices, previous, hint):
            solved = self._solve(coefficients, indices, guess)
            warps = solved.warps[indices[:, 0], indices[:, 1], :6]
            status = solved.status[indices[:, 0], indices[:, 1]]
            good = status == Status.CONVERGED
            good[good] = agreeing_seeds(points[good], warps[good])
            if good.sum() > best[0]:
                best = int(good.sum()), name, indices[good], warps[good]
            in_view = np.count_nonzero(status != Status.OUT_OF_VIEW)
            if best[0] >= max(fewest, _ENOUGH_SEEDS * in_view):
                break
        if best[0] < fewest:
            raise CorrelationError(
                "deformed image",
                "find the reference's pattern",
                expected=f"at least {fewest} of {len(points)} subsets of {self.settings.subset_px} px"
                f" with ZNCC above {self.settings.min_zncc:g}",
                got=f"{best[0]} that agree",
                remedy="check that both images show the same textured surface, or choose a larger subset",
            )
        return best[1:]

    def _propagate(
        self, coefficients: Grey, start: str, seeds: NDArray[np.int64], seed_warps: Float
    ) -> Field:
        grid, bands, rows = self._grid, self._threads, len(self._grid.y)
        solution = Solution.empty(grid.active.shape, self.settings.parameters)
        pending = grid.active.copy()
        wanted, guess = seeds, seed_warps
        while wanted.size:
            solution.warps[wanted[:, 0], wanted[:, 1], :6] = guess
            self._run(coefficients, solution, pending, wanted, (0, rows))
            if bands > 1:
                self._run_bands(coefficients, solution, pending, np.linspace(0, rows, bands + 1).astype(int))
                bands = 1
            # Bands know nothing of one another: what they left at their borders is reached here.
            self._run(coefficients, solution, pending, wanted[:0], (0, rows), spread=True)
            wanted = np.argwhere(grid.active & (solution.status == Status.NOT_REACHED))
            guess = self._from_nearest(wanted, solution.warps, solution.status)[:, :6]
        converged = grid.active & (solution.status == Status.CONVERGED)
        agreed = agreeing_field(grid.x, grid.y, solution.warps, converged)
        solution.status[converged & ~agreed] = Status.INCONSISTENT
        failed = solution.status != Status.CONVERGED
        solution.warps[failed] = solution.deviations[failed] = np.nan
        return Field(
            grid.x, grid.y, solution.warps, solution.deviations, solution.zncc, solution.iterations,
            solution.status, grid.active, start,
        )  # fmt: skip

    def _run_bands(
        self, coefficients: Grey, solution: Solution, pending: NDArray[np.bool_], edges: NDArray[np.int64]
    ) -> None:
        """Spread over bands of rows side by side; the kernel runs without the interpreter's lock."""
        nothing = np.empty((0, 2), np.int64)

        def work(first: int, last: int) -> None:
            self._run(coefficients, solution, pending, nothing, (first, last), spread=True)

        with ThreadPoolExecutor(len(edges) - 1) as pool:
            # Results are asked for so that an error is not lost.
            list(pool.map(work, edges[:-1], edges[1:]))

    def _from_nearest(self, indices: NDArray[np.int64], warps: Float, status: NDArray[np.int8]) -> Float:
        """Return guesses (n, 6) at grid `indices`, extrapolated from the nearest converged point."""
        from scipy.ndimage import distance_transform_edt

        rows, columns = indices.T
        missing = status != Status.CONVERGED
        everywhere = distance_transform_edt(missing, return_distances=False, return_indices=True)
        nearest = np.asarray(everywhere)[:, rows, columns]
        guess: Float = warps[nearest[0], nearest[1]]
        dx, dy = (
            self._grid.x[columns] - self._grid.x[nearest[1]],
            self._grid.y[rows] - self._grid.y[nearest[0]],
        )
        guess[:, 0] += guess[:, 1] * dx + guess[:, 2] * dy
        guess[:, 3] += guess[:, 4] * dx + guess[:, 5] * dy
        return guess


def _refuse_unusable(image: Grey, what: str, subset_px: int) -> None:
    if image.ndim != 2 or min(image.shape) < subset_px:
        raise CorrelationError(
            what,
            "read",
            expected=f"a grey image wider and higher than a subset of {subset_px} px",
            got=" x ".join(str(n) for n in image.shape[::-1]),
            remedy="use a larger image or a smaller subset",
        )
    if not np.isfinite(image).all():
        raise CorrelationError(
            what, "read", expected="finite grey levels", got="NaN or infinity", remedy="repair the image"
        )
