"""The right one of several periods: displacements of a pattern that repeats, checked against their twins.

The pattern of a lattice matches the deformed image in several places, one or more periods apart. Of these
twins, only the right one also matches what the pattern has besides the lattice: its irregularities, marks, or
parts that do not repeat. A surface is continuous, so all points of a coherent part of the field have chosen
the same period, and their evidence counts together. A part without evidence is declined, unless a motion that
the user expects names the period.
"""

from itertools import product

import numpy as np

from dic.correlation import kernel
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.solver import Solver
from dic.correlation.status import Status
from dic.correlation.twins import Twins, Unlike, side_by_side
from dic.typing import Float, Indices, Mask

_COHERENT = 0.25
"""Neighbours are coherent if they predict one another within this part of the period."""

_SAMPLE = 150
_FEWEST = 9
"""Largest and smallest number of points, with subsets side by side, that are compared with their twins."""
_BETTER_SHARE = 0.8
"""At this share of points, the right period matches better than each twin; a wrong one does so at few."""
_BETTER, _OF_RESIDUAL = 0.005, 0.5
"""Its ZNCC is then higher by at least this much, and by this part of its own distance from 1.

Uneven light that stays where it is makes a difference of less than a tenth of this between twins.
"""

_MARKED, _OF_MARK = 0.1, 0.1
"""A point is marked if its ZNCC with each twin in the reference is lower by this much.

At the right period, its residual is at most this part of that difference.
"""
_FEWEST_MARKED, _MARKED_SHARE = 3, 0.75
"""Number of marked points, and the share of them that match, which decide alone."""

_SEARCH_PX = 200.0
_SEARCHED = 400
"""Largest distance and number of the twins among which the right period is searched."""
_SEARCH_SAMPLE = 8
"""Number of points with which it is searched: those that are least like their twins in the reference."""

_HINT = 0.25
"""A hint decides if it lies within this part of the period of one of the twins."""
_PARTS = 8
"""Largest number of parts that are examined one by one."""


class PeriodChoice:
    """Check the displacements of one deformed image against those one or more periods away.

    `unlike`: how much points of the reference differ from their twins.
    """

    def __init__(self, reference: PreparedReference, twins: Twins, unlike: Unlike, solver: Solver) -> None:
        self._grid, self._settings = reference.grid, reference.settings
        self._twins, self._solver = twins, solver
        known = np.isfinite(unlike.residuals)
        order = np.argsort(-unlike.residuals[known], kind="stable")
        self._unlike = Unlike(unlike.indices[known][order], unlike.residuals[known][order])

    def settle(self, solution: kernel.Solution, expected: Float | None) -> bool:
        """Keep the points whose period is certain, and give the others the status "repeating".

        `expected`, shape (rows, columns, 6): warps of a motion that is known to be right within a fraction of
        the period, or None.

        Result: True if a part of the field has the period that `expected` names.
        """
        active, parts, hinted = self._grid.active, self._parts(solution), False
        certain = np.zeros_like(active)
        for part in parts:
            if self._is_certain(solution, part):
                certain |= part
        if parts and not certain.any():
            self._spread(solution, active & solution.converged & ~parts[0])
            certain, hinted = self._decided(solution, self._largest(solution, parts[0]), expected)
            self._spread(
                solution, active & ~certain & (solution.status != Status.OUT_OF_VIEW) & certain.any()
            )
        else:
            self._spread(solution, active & solution.converged & ~certain)
        if certain.any():
            for part in self._parts(solution):
                decided, by_hint = part, False
                if not (part & certain).any():
                    decided, by_hint = self._decided(solution, part, expected)
                certain, hinted = certain | decided, hinted | by_hint
        solution.status[active & solution.converged & ~certain] = Status.REPEATING
        return hinted

    def _parts(self, solution: kernel.Solution) -> list[Mask]:
        """Return the largest coherent parts of the field, the largest first."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        known = self._grid.active & solution.converged
        number = np.arange(known.size).reshape(known.shape)
        ends = []
        for down, right in ((1, 0), (0, 1)):
            rows, columns = known.shape[0] - down, known.shape[1] - right
            here, there = (slice(0, rows), slice(0, columns)), (slice(down, None), slice(right, None))
            joined = known[here] & known[there]
            joined &= self._coherent(solution.warps[here], solution.warps[there], down, right)
            ends.append(np.stack([number[here][joined], number[there][joined]]))
        first, second = np.concatenate(ends, axis=1)
        graph = coo_matrix((np.ones(len(first), np.bool_), (first, second)), (known.size, known.size))
        label = connected_components(graph, directed=False)[1].reshape(known.shape)
        sizes = np.bincount(label[known], minlength=1)
        largest = np.argsort(-sizes, kind="stable")[:_PARTS]
        return [known & (label == k) for k in largest if sizes[k]]

    def _largest(self, solution: kernel.Solution, within: Mask) -> Mask:
        """Return the coherent part that shares most points with a mask."""
        none = np.zeros_like(within)
        return max(self._parts(solution), key=lambda part: np.count_nonzero(part & within), default=none)

    def _coherent(self, here: Float, there: Float, down: int, right: int) -> Mask:
        """Return True where the warps of two neighbours predict one another."""
        dx = np.diff(self._grid.x)[None, :] if right else 0
        dy = np.diff(self._grid.y)[:, None] if down else 0
        errors = []
        for k in (0, 3):
            slope_x, slope_y = ((here[..., k + n] + there[..., k + n]) / 2 for n in (1, 2))
            errors.append(there[..., k] - here[..., k] - slope_x * dx - slope_y * dy)
        return np.asarray(np.hypot(*errors) < _COHERENT * self._twins.shortest_px)

    def _spread(self, solution: kernel.Solution, pending: Mask) -> None:
        """Solve points again, from all other points that have converged."""
        if pending.any():
            solution.status[pending] = Status.NOT_REACHED
            self._solver.propagate(solution, pending & ~self._grid.cut, in_bands=False)
            self._solver.solve_beside_cracks(solution)
            indices = np.argwhere(self._grid.active & (solution.status == Status.NOT_REACHED))
            if indices.size:
                guess = self._solver.guess_from_nearest(solution, indices)
                solution.put(tuple(indices.T), self._solver.solve(indices, guess))

    def _sampled(self, part: Mask) -> Indices:
        """Return points of a part (row, column) whose subsets lie side by side."""
        return side_by_side(part, -(-self._settings.subset_px // self._settings.step_px), _SAMPLE)

    def _is_certain(self, solution: kernel.Solution, part: Mask) -> bool:
        """Return True if the points of a part match clearly better than their twins."""
        indices = self._unlike.indices
        status = solution.status[tuple(indices.T)]
        near = self._near(part, indices) & (status != Status.OUT_OF_VIEW)
        own = np.where(part[tuple(indices.T)], 1.0 - solution.zncc[tuple(indices.T)], np.nan)
        if self._marks_match(own[near], self._unlike.residuals[near]):
            return True
        at = tuple(self._sampled(part).T)
        return self._is_better(self._sampled(part), solution.warps[at], 1.0 - solution.zncc[at])

    def _near(self, part: Mask, indices: Indices) -> Mask:
        """Return True for points that lie in a part or beside it."""
        import cv2

        around = cv2.dilate(part.astype(np.uint8), np.ones((5, 5), np.uint8))
        return np.asarray(around[tuple(indices.T)], np.bool_)

    def _marks_match(self, own: Float, unlike: Float) -> bool:
        """Return True if enough marked points match.

        `own`, shape (n,): residuals 1 - ZNCC. `unlike`, shape (n,): those of the twins in the reference.
        """
        marked = unlike >= _MARKED
        match = own[marked] <= _OF_MARK * unlike[marked]
        return bool(np.count_nonzero(match) >= max(_FEWEST_MARKED, _MARKED_SHARE * len(match)))

    def _is_better(self, indices: Indices, warps: Float, own: Float) -> bool:
        """Return True if points match clearly better than their twins; `own` (n,) are their residuals."""
        if len(indices) < _FEWEST:
            return False
        residuals = self._twins.residuals(self._solver, indices, warps)
        known = (np.isfinite(residuals).sum(axis=0) >= len(residuals) / 2) & np.isfinite(own)
        if np.count_nonzero(known) < max(_FEWEST, len(own) / 2):
            return False
        own, better = own[known], np.nanmin(residuals[:, known], axis=0) - own[known]
        return _are_better(better, float(np.median(own)))

    def _decided(self, solution: kernel.Solution, part: Mask, expected: Float | None) -> tuple[Mask, bool]:
        """Return the points of a part whose period is certain, and whether `expected` has named it.

        The part is moved to the right period if it has another one.
        """
        if self._is_certain(solution, part):
            return part, False
        multiples = self._searched(solution, part)
        if multiples is not None:
            return self._moved(solution, part, multiples), False
        if expected is not None:
            named = self._named(solution, part, expected)
            if named is not None:
                return self._moved(solution, part, named), True
        return np.zeros_like(part), False

    def _searched(self, solution: kernel.Solution, part: Mask) -> Float | None:
        """Return by how many periods a part has to move to the right period; None if this is not certain."""
        near = self._near(part, self._unlike.indices)
        indices, unlike = self._unlike.indices[near], self._unlike.residuals[near]
        few = indices[:_SEARCH_SAMPLE]
        if len(few) < _FEWEST_MARKED or np.median(unlike[:_SEARCH_SAMPLE]) < _BETTER:
            return None
        warps = self._warps_of(solution, part, indices)
        vectors = self._twins.repetition.vectors_at(self._grid.points_at(few))
        best: Float | None = None
        least = np.inf
        for multiples in _multiples(self._twins.repetition.vectors):
            residuals = self._twins.residual(self._solver, few, warps[: len(few)], multiples @ vectors)
            if np.isfinite(residuals).sum() >= len(few) / 2 and np.nanmedian(residuals) < least:
                best, least = multiples, float(np.nanmedian(residuals))
        if best is None:
            return None
        moved = self._solver.solve(indices, self._twins.away(indices, warps, best))
        own = np.where(moved.converged, 1.0 - moved.zncc, np.nan)
        in_view = moved.status != Status.OUT_OF_VIEW
        if self._marks_match(own[in_view], unlike[in_view]):
            return best
        sampled = self._sampled(part)
        moved = self._solver.solve(sampled, self._twins.away(sampled, solution.warps[tuple(sampled.T)], best))
        own = np.where(moved.converged, 1.0 - moved.zncc, np.nan)
        return best if self._is_better(sampled, moved.warps, own) else None

    def _warps_of(self, solution: kernel.Solution, part: Mask, indices: Indices) -> Float:
        """Return the warps (n, 6) of points of a part, and what they predict for points beside it."""
        warps: Float = solution.warps[tuple(indices.T)][:, :6].copy()
        beside = ~part[tuple(indices.T)]
        if beside.any():
            known = solution._replace(status=np.where(part, Status.CONVERGED, Status.NOT_REACHED))
            warps[beside] = self._solver.guess_from_nearest(known, indices[beside])
        return warps

    def _named(self, solution: kernel.Solution, part: Mask, expected: Float) -> Float | None:
        """Return by how many periods a part has to move to the period that `expected` names, or None."""
        warps = solution.warps[part]
        off = np.median(expected[part][:, [0, 3]] - warps[:, [0, 3]], axis=0)
        stretch = np.median(warps[:, [1, 2, 4, 5]], axis=0).reshape(2, 2) + np.eye(2)
        points = self._grid.points_at(np.argwhere(part))
        vectors = np.median(self._twins.repetition.vectors_at(points), axis=0) @ stretch.T
        multiples = np.rint(off @ np.linalg.pinv(vectors))
        rest_px = np.hypot(*(off - multiples @ vectors))
        return multiples if rest_px < _HINT * self._twins.shortest_px else None

    def _moved(self, solution: kernel.Solution, part: Mask, multiples: Float) -> Mask:
        """Solve a part of the field again, some periods away; return those of its points that cohere."""
        if multiples.any():
            indices = np.argwhere(part)
            guess = self._twins.away(indices, solution.warps[part], multiples)
            solution.put(tuple(indices.T), self._solver.solve(indices, guess))
        return part & self._largest(solution, part)


def tells_apart(unlike: Unlike, own: float) -> bool:
    """Return True if points differ so much from their twins that the right period can be found.

    `own`: residual 1 - ZNCC that the noise causes at the right period.
    """
    residuals = unlike.residuals[np.isfinite(unlike.residuals)]
    if np.count_nonzero(residuals >= _MARKED) >= _FEWEST_MARKED:
        return True
    return len(residuals) >= _FEWEST and _are_better(residuals - own, own)


def _are_better(better: Float, own: float) -> bool:
    """Return True if points match clearly better than their twins, by `better` (n,), at a residual `own`."""
    least = max(_BETTER, _OF_RESIDUAL * own)
    return bool(np.mean(better > 0.0) >= _BETTER_SHARE and np.median(better) >= least)


def _multiples(vectors: Float) -> Float:
    """Return the multiples of the vectors whose sums are not 0 and not too long, the shortest sums first."""
    most = int(_SEARCH_PX / np.hypot(*vectors[0])) + 1
    every = np.array(list(product(range(-most, most + 1), repeat=len(vectors))), np.float64)
    lengths = np.hypot(*(every @ vectors).T)
    order = np.argsort(lengths, kind="stable")
    return np.asarray(every[order][(lengths[order] > 0) & (lengths[order] <= _SEARCH_PX)][:_SEARCHED])
