"""A tile of points in the frames: its part of a frame is interpolated, and its points are correlated."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation import kernel
from dic.correlation.status import Status
from dic.live.points import Tile
from dic.typing import Mask

_LARGEST, _ALWAYS_PX = 6.0, 100_000
"""Largest window of a tile, as a multiple of that in the reference; a larger one follows from wrong warps. A
window of `_ALWAYS_PX` is never too large.
"""

_ONE = np.zeros((1, 2), np.int64)


class FollowedTile:
    """A tile with the memory for its part of the frames, and views of its results.

    `solution`: the results of all nodes of the camera. `memory`: memory for the interpolated part.
    """

    def __init__(self, tile: Tile, solution: kernel.Solution, memory: kernel.PartMemory) -> None:
        self.tile, self._memory = tile, memory
        own = solution.part(tile.nodes)
        self._solution = kernel.Solution(
            own.warps.reshape(*tile.shape, -1),
            own.std.reshape(*tile.shape, 6),
            own.status.reshape(tile.shape),
            own.zncc.reshape(tile.shape),
            own.iterations.reshape(tile.shape),
        )
        self._x, self._y = tile.grid.x.copy(), tile.grid.y.copy()
        self._grid = kernel.KernelGrid(self._x, self._y, tile.grid.pixels)
        self._deformed: kernel.Deformed | None = None
        self._window = tile.part

    def lay(self, image: NDArray[Any], window: kernel.Part) -> None:
        """Interpolate the window of a frame. A window without pixels, or a far too large one, is not."""
        self._deformed, self._window = None, window
        room_px = min(window.bottom - window.top, window.right - window.left)
        most_px = max(_LARGEST * self.tile.part.pixels, _ALWAYS_PX)
        if room_px > 2 * kernel.EDGE_PX and window.pixels <= most_px:
            self._deformed = self._memory.lay(image, window)

    def solve(self, method: kernel.Method, chosen: Mask | None) -> None:
        """Correlate the `chosen` points, or all, from their warps; the others keep what they have."""
        tile, solution, window = self.tile, self._solution, self._window
        whole = tile.whole if chosen is None else tile.whole & chosen
        seeds = tile.points if whole.all() else tile.points[whole]
        if self._deformed is None:
            own = tile.points if chosen is None else tile.points[chosen]
            solution.status[own[:, 0], own[:, 1]] = Status.OUT_OF_VIEW
            return
        # The kernel rounds warps to float32. So its coordinates are such that the displacements are small.
        row, column = tile.points[len(tile.points) // 2]
        u, v = (round(float(solution.warps[row, column, k])) for k in (0, 3))
        right, down = tile.part.left + u - window.left, tile.part.top + v - window.top
        np.add(tile.grid.x, right, out=self._x)
        np.add(tile.grid.y, down, out=self._y)
        solution.warps[..., 0] -= u
        solution.warps[..., 3] -= v
        if len(seeds):
            image = _moved(tile.image, right, down)
            kernel.correlate_seeds(image, self._deformed, method, self._grid, seeds, solution, tile.prepared)
        if tile.cut:
            self._solve_cut(self._deformed, method, chosen, (right, down))
        solution.warps[..., 0] += u
        solution.warps[..., 3] += v

    def _solve_cut(
        self, deformed: kernel.Deformed, method: kernel.Method, chosen: Mask | None, offset: tuple[int, int]
    ) -> None:
        """Correlate those of the `chosen` points whose subset is cut by a crack."""
        solution, (right, down) = self._solution, offset
        for number, point in zip(np.flatnonzero(~self.tile.whole), self.tile.cut, strict=True):
            if chosen is not None and not chosen[number]:
                continue
            (row, column), image = point.place, _moved(point.image, right, down)
            grid = kernel.KernelGrid(point.grid.x + right, point.grid.y + down, point.grid.pixels)
            rows, columns = slice(row, row + 1), slice(column, column + 1)
            own = kernel.Solution(
                solution.warps[rows, columns].copy(),
                solution.std[rows, columns].copy(),
                solution.status[rows, columns].copy(),
                solution.zncc[rows, columns].copy(),
                solution.iterations[rows, columns].copy(),
            )
            kernel.correlate_seeds(image, deformed, method, grid, _ONE, own, point.prepared)
            solution.put((rows, columns), own)


def _moved(image: kernel.KernelReference, right: int, down: int) -> kernel.KernelReference:
    """Return a reference whose coordinates are larger by some pixels."""
    return image._replace(origin=image.origin - down * image.pitch - right)
