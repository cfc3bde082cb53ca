"""Correlate the points of one reference with one deformed image, from guesses and by propagation."""

import numpy as np

from dic.correlation import kernel
from dic.correlation.cracks import limited_to, visible_neighbours
from dic.correlation.laid_rows import LaidDeformed
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.correlation.working_rows import propagation_rows, strips
from dic.image.memory import give_back_memory
from dic.image.spline import halfway_noise_gain, slope_noise_gain
from dic.image.threads import balanced_bands, bands_of, in_parallel, with_neighbours
from dic.typing import Float, Indices, Mask

_TRIES = 3
"""Largest number of neighbours whose warps are tried as first guesses for a point beside a crack."""

_BANDS = 16
"""Number of bands of rows that are solved in parallel; this number keeps several processors busy."""

_BAND_PX = 1_000_000
"""Largest number of pixels of a band; a larger image has more bands."""


def method_of(settings: CorrelationSettings, smoothing: tuple[float, ...] = (1.0,)) -> kernel.Method:
    """Return the correlation settings in the form that the kernel needs.

    The images were smoothed by a filter with the taps `smoothing`.
    """
    return kernel.Method(
        (0.0,) * (settings.order + 1),
        (0.0,) * settings.parameters,
        settings.radius_px,
        settings.min_zncc,
        settings.tolerance_px,
        settings.max_iterations,
        halfway_noise_gain(settings.order, smoothing),
        slope_noise_gain(settings.order, smoothing),
    )


class Solver:
    """Correlate the points of a reference with one deformed image.

    `deformed`: the deformed image, which may differ in shape from the reference.
    """

    def __init__(self, reference: PreparedReference, deformed: LaidDeformed) -> None:
        self._reference, self._deformed = reference, deformed
        self._method = method_of(reference.settings, reference.smoothing.taps)
        self._prepared: kernel.Prepared | None = None
        self._counted = False

    def solve(self, indices: Indices, warps: Float, most_iterations: int | None = None) -> kernel.Solution:
        """Run IC-GN at grid `indices` (n, 2) from guesses `warps` (n, 6 or 12).

        Warp parameters that a guess does not give start at 0. A point whose guess has NaN is not tried and
        keeps the status "not reached". `most_iterations` replaces the largest number of iterations.
        """
        method = self._method
        if most_iterations is not None:
            method = method._replace(max_iterations=most_iterations)
        reference, radius = self._reference, self._method.radius
        solution = kernel.Solution.empty((len(indices),), reference.settings.parameters)
        solution.warps[:, : warps.shape[1]] = warps
        guessed = np.flatnonzero(np.isfinite(warps).all(axis=1))
        cut, at = reference.grid.cut[indices[:, 0], indices[:, 1]], reference.grid.points_at(indices)
        for strip in strips(at[guessed], solution.warps[guessed], radius, whole=not reference.image.in_bands):
            image, deformed = reference.image.rows(*strip.here), self._deformed.rows(*strip.there)
            chosen = guessed[strip.members]
            self._correlate(image, deformed, method, indices, chosen[~cut[chosen]], solution)
            for k in chosen[cut[chosen]]:
                limited = limited_to(image, int(at[k, 0]), int(at[k, 1]), reference.grid.usable, radius)
                self._correlate(limited, deformed, method, indices, np.array([k]), solution)
        return solution

    def _correlate(
        self,
        image: kernel.KernelReference,
        deformed: kernel.Deformed,
        method: kernel.Method,
        indices: Indices,
        chosen: Indices,
        solution: kernel.Solution,
    ) -> None:
        """Correlate the `chosen` points, and put the results into `solution`.

        The kernel receives a smaller grid of points: only the rows and columns in which chosen points lie.
        """
        grid = self._reference.grid
        rows, row = np.unique(indices[chosen, 0], return_inverse=True)
        columns, column = np.unique(indices[chosen, 1], return_inverse=True)
        small = kernel.Solution.empty((len(rows), len(columns)), self._reference.settings.parameters)
        small.put((row, column), solution.part(chosen))
        small_grid = kernel.KernelGrid(grid.x[columns], grid.y[rows], grid.pixels[np.ix_(rows, columns)])
        seeds = np.stack([row, column], axis=1)
        kernel.correlate_seeds(image, deformed, method, small_grid, seeds, small)
        solution.put((chosen,), small.part((row, column)))

    def propagate(self, solution: kernel.Solution, pending: Mask, *, in_bands: bool) -> None:
        """Solve pending points by propagation from converged points, in the order of decreasing ZNCC.

        If `in_bands` is True, the grid is first cut into bands of rows. The bands are solved in parallel and
        independently. Points that remain unsolved at the borders of bands are solved afterwards. The number
        of bands does not depend on the number of threads, so the results do not depend on the machine.
        """
        if not self._counted:
            # Count images here, because several solvers may try seeds but only one of them propagates.
            grid, parameters = self._reference.grid, self._reference.settings.parameters
            self._prepared = self._reference.memory.for_next_image(grid, parameters)
            self._counted = True
        if in_bands:
            bands = self._seeded_bands(solution, pending)
            if self._reference.image.in_bands:
                give_back_memory()
            in_parallel(
                lambda band: self._propagate_rows(solution.part(band), pending[band], band),
                bands,
                self._reference.threads,
            )
        if self._reference.image.in_bands:
            give_back_memory()
        self._propagate_from_fronts(solution, pending)

    def _propagate_from_fronts(self, solution: kernel.Solution, pending: Mask) -> None:
        """Propagate from all converged points that have a pending neighbour.

        In a large image, one band of rows is solved after another, together with the row before and the row
        after the band. This is repeated until no band has a front that has not been tried.
        """
        rows = len(pending)
        height = -(-rows // self._band_count) if self._reference.image.in_bands else rows
        bands = bands_of(rows, height)
        tried_fronts = [np.zeros_like(pending[with_neighbours(band, rows, 1)]) for band in bands]
        again = True
        while again:
            again = False
            for band, tried_before in zip(bands, tried_fronts, strict=True):
                part = with_neighbours(band, rows, 1)
                own = pending[part].copy()
                own[: band.start - part.start] = own[len(own) - (part.stop - band.stop) :] = False
                again |= self._propagate_fronts_of(solution.part(part), own, tried_before, part)
                pending[band] = own[band.start - part.start : band.stop - part.start]

    def _propagate_fronts_of(
        self, solution: kernel.Solution, pending: Mask, tried_before: Mask, rows: slice
    ) -> bool:
        """Propagate in some rows from fronts that were not tried before; return False without any."""
        fronts = solution.converged & next_to(pending) & ~tried_before
        if not fronts.any():
            return False
        # Other converged points have no pending neighbour. Mark them NOT_REACHED so that the kernel does not
        # queue them.
        status = np.where(solution.converged & ~fronts, np.int8(Status.NOT_REACHED), solution.status)
        tried = pending.copy()
        self._propagate_rows(solution._replace(status=status), pending, rows)
        solution.status[tried] = status[tried]
        tried_before |= fronts | (tried & solution.converged)
        return True

    def _propagate_rows(self, part: kernel.Solution, pending: Mask, rows: slice) -> None:
        """Run the kernel in some rows of the grid, from their converged points to their pending points.

        If the rows of the deformed image that are expected to show these points are not enough, the rows of
        the grid are solved anew with more rows of the image.
        """
        grid, prepared = self._reference.grid, self._prepared
        if not part.converged.any():
            return
        if prepared is not None:
            prepared = kernel.Prepared(prepared.known[rows], prepared.records[rows])
        band = kernel.KernelGrid(grid.x, grid.y[rows], grid.pixels[rows])
        laid = self._reference.image
        if not laid.in_bands:
            image, deformed = laid.rows(0, 0), self._deformed.rows(0, 0)
            kernel.propagate(image, deformed, self._method, band, part, pending, prepared)
            return
        radius = self._method.radius
        image = laid.rows(int(band.y[0]) - radius, int(band.y[-1]) + radius + 1)
        for there in propagation_rows(band, part, radius, self._deformed.height):
            trial, left = part.copy(), pending.copy()
            kernel.propagate(image, self._deformed.rows(*there), self._method, band, trial, left, prepared)
            if not (trial.status == kernel.NOT_LAID).any():
                break
        part.put((slice(None),), trial)
        pending[...] = left
        # The rows of the next band need blocks of other sizes.
        del image
        give_back_memory()

    @property
    def _band_count(self) -> int:
        """Number of bands of rows of the grid. It does not depend on the number of threads."""
        return max(_BANDS, -(-self._reference.grid.usable.size // _BAND_PX))

    def _seeded_bands(self, solution: kernel.Solution, pending: Mask) -> list[slice]:
        """Cut the grid into bands of about equal work; in bands without solved points, solve a few points."""
        bands = balanced_bands(pending.sum(axis=1), self._band_count)
        converged = solution.converged
        seeds = []
        for band in bands:
            if not converged[band].any():
                places = np.argwhere(pending[band]) + np.array([band.start, 0])
                middle = places[places[:, 0] == places[len(places) // 2, 0]]
                seeds.append(middle[[len(middle) // 4, len(middle) // 2, 3 * len(middle) // 4]])
        if seeds and converged.any():
            indices = np.concatenate(seeds)
            solution.put(tuple(indices.T), self.solve(indices, self.guess_from_nearest(solution, indices)))
            pending &= ~solution.converged
        return bands

    def guess_from_nearest(self, solution: kernel.Solution, indices: Indices) -> Float:
        """Return guesses (n, 6) at grid `indices`, extrapolated from the nearest converged point."""
        converged = solution.converged
        # The nearest converged point always has a neighbour without a value. So search only such points.
        borders = np.argwhere(converged & next_to(~converged))
        return self._extrapolated(solution, borders[_nearest(borders, indices)], indices)

    def _extrapolated(self, solution: kernel.Solution, origins: Indices, indices: Indices) -> Float:
        """Return guesses (n, 6) at n grid `indices`, extrapolated from the warps of n points at `origins`."""
        guess: Float = solution.warps[origins[:, 0], origins[:, 1], :6].copy()
        grid = self._reference.grid
        dx, dy = (grid.points_at(indices) - grid.points_at(origins)).T
        guess[:, 0] += guess[:, 1] * dx + guess[:, 2] * dy
        guess[:, 3] += guess[:, 4] * dx + guess[:, 5] * dy
        return guess

    def solve_beside_cracks(self, solution: kernel.Solution) -> None:
        """Solve points whose subset is cut by a crack, from neighbours on the same side of the crack."""
        grid = self._reference.grid
        tried: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for row, column in np.argwhere(grid.cut & ~solution.converged):
            tried[int(row), int(column)] = []
        while True:
            converged, pairs = solution.converged, []
            for place, origins in tried.items():
                if converged[place] or len(origins) >= _TRIES:
                    continue
                neighbours = visible_neighbours(grid, grid.usable, *place, converged)
                untried = next((origin for origin in neighbours if origin not in origins), None)
                if untried is not None:
                    origins.append(untried)
                    pairs.append((place, untried))
            if not pairs:
                return
            places = np.array([place for place, _ in pairs], np.int64)
            guess = self._extrapolated(solution, np.array([origin for _, origin in pairs], np.int64), places)
            solution.put(tuple(places.T), self.solve(places, guess))


def next_to(mask: Mask) -> Mask:
    """Return True for elements next to a True element above, below, to the left or to the right."""
    near = np.zeros_like(mask)
    near[1:] |= mask[:-1]
    near[:-1] |= mask[1:]
    near[:, 1:] |= mask[:, :-1]
    near[:, :-1] |= mask[:, 1:]
    return near


def _nearest(places: Indices, indices: Indices) -> Indices:
    """Return for each of the `indices` (n, 2) the first of the nearest `places` (m, 2)."""
    return np.array([np.square(index - places).sum(axis=1).argmin() for index in indices], np.int64)
