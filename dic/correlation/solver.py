"""Solve points of interest of one reference in one deformed image: given guesses, and from point to point."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.correlation import kernel
from dic.correlation.cracks import CutReference, visible_neighbours
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.image.region import PointGrid
from dic.image.spline import halfway_noise_gain, slope_noise_gain
from dic.image.threads import balanced_bands, in_parallel

Float = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

_KEPT = 4.25
"""Most that is kept of the subsets, in images of float32: quadratic ones at a step of 5 px need no more."""

_TRIES = 3
"""Neighbours from which a point beside a crack is tried."""

_BANDS = 16
"""Bands of rows that are solved side by side: enough to keep several processors busy to the end."""


class Solution(NamedTuple):
    """What IC-GN found, for points in a row or on a grid, in the order in which the kernel takes it."""

    warps: Float
    std: Float
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

    def put(self, where: tuple[NDArray[np.int64], ...], part: "Solution") -> None:
        """Write the solution of some points in their places."""
        self.warps[where], self.std[where] = part.warps, part.std
        self.status[where], self.zncc[where] = part.status, part.zncc
        self.iterations[where] = part.iterations

    def part(self, where: slice | Indices | tuple[Indices, Indices]) -> "Solution":
        """Return a view of some rows of a grid, or a copy of the points of a list of places."""
        return Solution(
            self.warps[where],
            self.std[where],
            self.status[where],
            self.zncc[where],
            self.iterations[where],
        )

    @property
    def converged(self) -> Mask:
        """Which points have a value."""
        return np.asarray(self.status == Status.CONVERGED)


class SubsetMemory:
    """What IC-GN found out about a reference's subsets, kept for the later images of a series.

    A pair has no use for it, so nothing is kept before the second image; nor is where it would take more than
    `_KEPT` times the reference image. Results are the same with and without.
    """

    def __init__(self) -> None:
        self._images = 0
        self._prepared: kernel.Prepared | None = None

    def of_next_image(self, grid: PointGrid, image_px: int, parameters: int) -> kernel.Prepared | None:
        """Return what is known before another image is correlated, to be filled by it; None for a pair."""
        self._images += 1
        if self._images == 2:
            size = 4 * kernel.record_length(parameters) * grid.active.size
            if size <= _KEPT * 4 * image_px:
                self._prepared = kernel.Prepared.empty(grid.active.shape, parameters)
        return self._prepared

    @property
    def kept_bytes(self) -> int:
        """How much memory is set aside."""
        return 0 if self._prepared is None else sum(part.nbytes for part in self._prepared)


@dataclass(frozen=True)
class PreparedReference:
    """All of a reference that does not depend on the deformed image.

    Attributes
    ----------
    image : kernel.Reference
    usable : ndarray of bool, shape (height, width)
        Pixels that subsets may use.
    grid : PointGrid
    settings : CorrelationSettings
    threads : int
    memory : SubsetMemory
    """

    image: kernel.Reference
    usable: Mask
    grid: PointGrid
    settings: CorrelationSettings
    threads: int
    memory: SubsetMemory = field(default_factory=SubsetMemory)


class Solver:
    """Solves the points of a reference in one deformed image.

    Parameters
    ----------
    reference : PreparedReference
    deformed : kernel.Deformed
        As `kernel.lay_coefficients` gives it; its shape may differ from the reference's.
    """

    def __init__(self, reference: PreparedReference, deformed: kernel.Deformed) -> None:
        settings = reference.settings
        self._reference, self._deformed = reference, deformed
        self._threads = reference.threads
        self._prepared: kernel.Prepared | None = None
        self._counted = False
        # Compiled code is chosen by the length of these: one for each tap and for each parameter of a warp.
        self._taps, self._shape = (0.0,) * (settings.order + 1), (0.0,) * settings.parameters
        self._limits = kernel.Limits(
            settings.radius_px,
            settings.min_zncc,
            settings.tolerance_px,
            settings.max_iterations,
            halfway_noise_gain(settings.order),
            slope_noise_gain(settings.order),
        )

    def solve(self, indices: Indices, warps: Float) -> Solution:
        """Run IC-GN at grid `indices` (n, 2) from `warps` (n, 6 or fewer than a warp has: the rest is 0).

        A warp with NaN is no guess: its point stays "not reached".
        """
        parameters = self._reference.settings.parameters
        solution = Solution.empty((len(indices),), parameters)
        solution.warps[:, : warps.shape[1]] = warps
        guessed = np.isfinite(warps).all(axis=1)
        cut = self._reference.grid.cut[indices[:, 0], indices[:, 1]]
        self._run(self._reference.image, indices, np.flatnonzero(guessed & ~cut), solution)
        beside_cracks = np.flatnonzero(guessed & cut)
        if beside_cracks.size:
            image = CutReference(self._reference.image)
            for k in beside_cracks:
                (x, y), radius = self._reference.grid.points_at(indices[k : k + 1])[0], self._limits.radius
                with image.limited_to(int(x), int(y), self._reference.usable, radius) as limited:
                    self._run(limited, indices, np.array([k]), solution)
        return solution

    def _run(self, image: kernel.Reference, indices: Indices, chosen: Indices, solution: Solution) -> None:
        """Run the kernel at the chosen ones of `indices`, on their rows and columns of the grid only."""
        grid = self._reference.grid
        rows, row = np.unique(indices[chosen, 0], return_inverse=True)
        columns, column = np.unique(indices[chosen, 1], return_inverse=True)
        small = Solution.empty((len(rows), len(columns)), self._reference.settings.parameters)
        small.put((row, column), solution.part(chosen))
        seeds, pixels = np.stack([row, column], axis=1), grid.pixels[np.ix_(rows, columns)]
        kernel.correlate_grid(
            image, self._deformed, self._taps, self._shape, self._limits,
            grid.x[columns], grid.y[rows], pixels, seeds,
            *small, np.ones(small.status.shape, np.bool_), False,
        )  # fmt: skip
        solution.put((chosen,), small.part((row, column)))

    def propagate(self, solution: Solution, pending: Mask, *, side_by_side: bool) -> None:
        """Spread from the converged points over those `pending`, the best first.

        Side by side, the grid is cut into bands of rows. Bands know nothing of one another: what they leave
        at their borders is reached afterwards. Their number is not that of the threads, so that results do
        not depend on the machine.
        """
        if not self._counted:
            # Solvers that only try seeds, as in an image turned in vain, do not make a series.
            size, parameters = self._reference.usable.size, self._reference.settings.parameters
            self._prepared = self._reference.memory.of_next_image(self._reference.grid, size, parameters)
            self._counted = True
        if side_by_side:
            bands = self._seeded_bands(solution, pending)
            in_parallel(
                lambda band: self._spread(solution.part(band), pending[band], band), bands, self._threads
            )
        beginning = solution.converged & next_to(pending)
        if not beginning.any():
            return
        # All others have nothing left to reach: hidden, they are not asked in vain.
        status = np.where(solution.converged & ~beginning, np.int8(Status.NOT_REACHED), solution.status)
        reached = pending.copy()
        self._spread(solution._replace(status=status), pending, slice(None))
        solution.status[reached] = status[reached]

    def _spread(self, part: Solution, pending: Mask, band: slice) -> None:
        """Run the kernel from the converged points of some rows of the grid over those pending there."""
        grid, prepared = self._reference.grid, self._prepared
        if prepared is not None:
            prepared = kernel.Prepared(prepared.known[band], prepared.records[band])
        kernel.correlate_grid(
            self._reference.image, self._deformed, self._taps, self._shape, self._limits,
            grid.x, grid.y[band], grid.pixels[band], np.empty((0, 2), np.int64), *part, pending, True,
            prepared,
        )  # fmt: skip

    def _seeded_bands(self, solution: Solution, pending: Mask) -> list[slice]:
        """Cut the grid into bands of rows of like many pending points; solve some where a band knows none."""
        bands = balanced_bands(pending.sum(axis=1), _BANDS)
        known = solution.converged
        starts = []
        for band in bands:
            if not known[band].any():
                places = np.argwhere(pending[band]) + np.array([band.start, 0])
                middle = places[places[:, 0] == places[len(places) // 2, 0]]
                starts.append(middle[[len(middle) // 4, len(middle) // 2, 3 * len(middle) // 4]])
        if starts and known.any():
            indices = np.concatenate(starts)
            solution.put(tuple(indices.T), self.solve(indices, self.from_nearest(solution, indices)))
            pending &= ~solution.converged
        return bands

    def extrapolated(self, solution: Solution, origins: Indices, indices: Indices) -> Float:
        """Return guesses (n, 6) at grid `indices` from the warps of as many points at `origins`."""
        guess: Float = solution.warps[origins[:, 0], origins[:, 1], :6].copy()
        grid = self._reference.grid
        dx, dy = (grid.points_at(indices) - grid.points_at(origins)).T
        guess[:, 0] += guess[:, 1] * dx + guess[:, 2] * dy
        guess[:, 3] += guess[:, 4] * dx + guess[:, 5] * dy
        return guess

    def from_nearest(self, solution: Solution, indices: Indices) -> Float:
        """Return guesses (n, 6) at grid `indices`, extrapolated from the nearest converged point."""
        from scipy.spatial import cKDTree

        converged = solution.converged
        # The nearest has a neighbour without a value: one step on towards the asking point would be nearer.
        known = np.argwhere(converged & next_to(~converged))
        # A balanced tree takes longer to build than these few questions to answer.
        _, nearest = cKDTree(known, balanced_tree=False, compact_nodes=False).query(indices)
        origins = np.asarray(known[nearest], np.int64)
        return self.extrapolated(solution, origins, indices)

    def solve_beside_cracks(self, solution: Solution) -> None:
        """Solve the points whose subsets are cut into parts, from neighbours on their own side."""
        grid = self._reference.grid
        tried: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for row, column in np.argwhere(grid.cut & ~solution.converged):
            tried[int(row), int(column)] = []
        while True:
            known, pairs = solution.converged, []
            for place, origins in tried.items():
                if known[place] or len(origins) >= _TRIES:
                    continue
                neighbours = visible_neighbours(grid, self._reference.usable, *place, known)
                untried = next((origin for origin in neighbours if origin not in origins), None)
                if untried is not None:
                    origins.append(untried)
                    pairs.append((place, untried))
            if not pairs:
                return
            places = np.array([place for place, _ in pairs], np.int64)
            guess = self.extrapolated(solution, np.array([origin for _, origin in pairs], np.int64), places)
            solution.put(tuple(places.T), self.solve(places, guess))


def next_to(mask: Mask) -> Mask:
    """Return which elements have a true one right above, below, to the left or to the right of them."""
    near = np.zeros_like(mask)
    near[1:] |= mask[:-1]
    near[:-1] |= mask[1:]
    near[:, 1:] |= mask[:, :-1]
    near[:, :-1] |= mask[:, 1:]
    return near
