"""Follows the points of a camera's gauges from frame to frame.

Each point starts from its last warp, or from a linear extrapolation of its last two where that has been
closer. Points that fail start from a neighbour once more, and are then tried less and less often, so that
they do not hold up the frames. Of a tile without any point, a few points are tried.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation import kernel
from dic.correlation.consistency import is_plausible, predicts
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.solver import method_of
from dic.correlation.status import Status
from dic.live.followed_tile import FollowedTile
from dic.live.points import GaugePoints
from dic.live.settings import LiveSettings
from dic.live.windows import windows
from dic.typing import Float, Indices, Mask

_PROBES = 5
"""Number of points of a lost tile that are tried in each frame."""

_LONGEST_WAIT = 32
"""A point that fails again and again is tried at least once in this number of frames."""

_MEMORY = 0.8
"""Weight of the earlier frames in the mean errors of both predictions."""

_MOVED = [0, 3]
_NONE = np.zeros(0, np.int64)


class Tracker:
    """Follow points from frame to frame.

    `reference`: the prepared reference. `points`: the points. `shape`: height and width of the images.

    The arrays have one element for each node of `points`: `warps`, shape (nodes, 6 or 12), `std`, shape
    (nodes, 6), `status` and `zncc`. They are those of the last frame.
    """

    def __init__(
        self,
        reference: PreparedReference,
        points: GaugePoints,
        shape: tuple[int, ...],
        settings: LiveSettings,
    ) -> None:
        self.points, self._settings, self._shape = points, settings, shape
        own, parameters, count = reference.settings, reference.settings.parameters, len(points.used)
        self._radius = own.radius_px
        method = method_of(own, reference.smoothing.taps)
        self._method = method._replace(max_iterations=min(settings.most_iterations, method.max_iterations))
        self._solution = kernel.Solution.empty((count,), parameters)
        self.warps, self.std = self._solution.warps, self._solution.std
        self.status, self.zncc = self._solution.status, self._solution.zncc
        self._tiles = [
            FollowedTile(
                tile, self._solution, kernel.PartMemory(own.order, reference.mean, reference.smoothing.taps)
            )
            for tile in points.tiles
        ]
        number = points.points
        self._at = number
        self._x, self._y = points.x[number], points.y[number]
        self._starts = np.searchsorted(number, [tile.nodes.start for tile in points.tiles])
        self._tile_of = np.repeat(np.arange(len(points.tiles)), np.diff(np.append(self._starts, len(number))))
        self._neighbours, self._exists = points.neighbours
        self._apart = np.stack(
            [self._x[:, None] - self._x[self._neighbours], self._y[:, None] - self._y[self._neighbours]]
        )
        self.known = np.ones(len(number), np.bool_)
        self._before, self._step = np.zeros((2, len(number), parameters))
        self._misses, self._wait = np.zeros((2, len(number)), np.int64)
        self._errors, self.extrapolates = np.array([0.0, 1.0]), False
        self.windows: list[kernel.Part] = []

    @property
    def lost_tiles(self) -> Indices:
        """Numbers of the tiles without any point that has a displacement."""
        if self.known.all():
            return _NONE
        counts = np.bincount(self._tile_of[self.known], minlength=len(self._tiles))
        return np.flatnonzero(counts == 0)

    def probes(self, tile: int) -> Indices:
        """Return the numbers, among `points.points`, of the points of a tile that stand for it."""
        own = np.flatnonzero(self._tile_of == tile)
        return np.asarray(own[np.unique(np.linspace(0, len(own) - 1, _PROBES).round().astype(int))])

    def windows_of(self, numbers: Indices, starts: Indices) -> list[kernel.Part]:
        """Return the parts of the last frame that show groups of points; they may reach beyond the image.

        `numbers`: numbers of the points among `points.points`, group by group. `starts`: the first of each.
        """
        warps = self.warps[self._at[numbers]]
        return windows(self._x[numbers], self._y[numbers], warps, self._radius, 0, starts)

    def follow(self, image: NDArray[Any], ratio: float = 1.0) -> None:
        """Find the points in the next frame.

        `ratio`: time since the last frame, divided by the time between the last two.
        """
        at, was_known = self._at, self.known
        guess = self.warps[at]
        if self.extrapolates:
            guess += ratio * self._step
        due = self._due()
        parts = windows(self._x, self._y, guess, self._radius, self._settings.room_px, self._starts)
        self.windows = [part.within(self._shape) for part in parts]
        self.status[at[due]] = Status.NOT_REACHED
        self.warps[at] = guess
        everything = bool(due.all())
        for number, tile in enumerate(self._tiles):
            chosen = None if everything else due[self._starts[number] :][: len(tile.tile.points)]
            if chosen is None or chosen.any():
                tile.lay(image, self.windows[number])
                tile.solve(self._method, chosen)
        known = self._consistent()
        failed = due & ~known
        if failed.any():
            known = self._tried_again(failed, known)
        self._learn(known, was_known, due, ratio)

    def place(self, numbers: Indices, warps: Float) -> None:
        """Let the next frame start from these warps (n, 6 or 12) at points with these numbers."""
        self.warps[self._at[numbers], : warps.shape[1]] = warps
        self.warps[self._at[numbers], warps.shape[1] :] = 0.0
        self._before[numbers] = self.warps[self._at[numbers]]
        self._step[numbers], self._misses[numbers], self._wait[numbers] = 0.0, 0, 0

    def place_tile(self, tile: int, number: int, warp: Float) -> None:
        """Let a tile start from the warp (6,) of one of its points, continued to its other points."""
        own = np.flatnonzero(self._tile_of == tile)
        dx, dy = self._x[own] - self._x[number], self._y[own] - self._y[number]
        warps = np.tile(warp, (len(own), 1))
        warps[:, 0] += warp[1] * dx + warp[2] * dy
        warps[:, 3] += warp[4] * dx + warp[5] * dy
        self.place(own, warps)

    def _due(self) -> Mask:
        """Return which points are tried in this frame."""
        if self.known.all():
            return self.known
        np.maximum(self._wait - 1, 0, out=self._wait)
        due = self._wait == 0
        for tile in self.lost_tiles:
            due[self._tile_of == tile] = False
            due[self.probes(int(tile))] = True
        return np.asarray(due)

    def _consistent(self) -> Mask:
        """Return which points have converged, with displacements that a neighbour predicts."""
        at = self._at
        known = self.status[at] == Status.CONVERGED
        planes = np.ascontiguousarray(self.warps[at, :6].T)
        with np.errstate(invalid="ignore", over="ignore"):
            known &= is_plausible(planes)
            # Nearly always, one neighbour of each point is enough.
            first = self._neighbours[:, 0]
            if known.all() and predicts(planes[:, first], planes, *self._apart[:, :, 0]).all():
                return np.asarray(known)
            around = self._exists & known[self._neighbours]
            confirmed = predicts(planes[:, self._neighbours], planes[:, :, None], *self._apart)
        # A point without neighbours is compared with nothing.
        consistent = (confirmed & around).any(axis=1) | ~around.any(axis=1)
        self.status[at[known & ~consistent]] = Status.INCONSISTENT
        return np.asarray(known & consistent)

    def _tried_again(self, failed: Mask, known: Mask) -> Mask:
        """Try the points that failed from the nearest point that did not, once more; return the known points.

        Points of tiles in which all points failed are not tried again.
        """
        again = np.zeros_like(failed)
        for tile in np.unique(self._tile_of[failed]):
            own = self._tile_of == tile
            some, others = np.flatnonzero(own & failed), np.flatnonzero(own & known)
            if not others.size:
                continue
            dx, dy = (at[some][:, None] - at[others] for at in (self._x, self._y))
            nearest = (dx * dx + dy * dy).argmin(axis=1)
            start = self.warps[self._at[others[nearest]]]
            dx, dy = (each[np.arange(len(some)), nearest] for each in (dx, dy))
            start[:, 0] += start[:, 1] * dx + start[:, 2] * dy
            start[:, 3] += start[:, 4] * dx + start[:, 5] * dy
            self.warps[self._at[some]] = start
            again[some] = True
            chosen = again[self._starts[tile] :][: len(self._tiles[tile].tile.points)]
            self._tiles[tile].solve(self._method, chosen)
        return self._consistent() if again.any() else known

    def _learn(self, known: Mask, was_known: Mask, due: Mask, ratio: float) -> None:
        """Keep what the next frame needs: the last steps, which prediction was closer, and what was lost."""
        both, warps = known & was_known, self.warps[self._at]
        step = warps - self._before
        if both.any():
            moved, last = step[both][:, _MOVED], self._step[both][:, _MOVED]
            errors = np.abs(moved).mean(), np.abs(moved - ratio * last).mean()
            self._errors = _MEMORY * self._errors + (1.0 - _MEMORY) * np.array(errors)
            self.extrapolates = bool(self._errors[1] < self._errors[0])
        if both.all():
            self._step, self._before, self.known = step, warps, known
            return
        lost = ~known
        # Lost points move with the others until they are found.
        carried = self._before[lost]
        if both.any():
            carried[:, _MOVED] += step[both][:, _MOVED].mean(axis=0)
        warps[lost] = carried
        self.warps[self._at[lost]] = carried
        step[~both] = 0.0
        self._misses[known] = self._wait[known] = 0
        missed = due & lost
        self._misses[missed] += 1
        self._wait[missed] = np.minimum(2 ** np.minimum(self._misses[missed] - 1, 10), _LONGEST_WAIT)
        found = np.unique(self._tile_of[known & ~was_known])
        # A tile that is found again is tried as a whole.
        self._wait[lost & np.isin(self._tile_of, found)] = 0
        self._step, self._before, self.known = step, warps, known
