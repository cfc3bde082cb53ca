"""Reliability-guided propagation over a grid of points.

Points are visited from the best outwards: B. Pan, "Reliability-guided digital image correlation for
image deformation measurement", Applied Optics 48 (2009) 1535-1542.
"""

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.heap import Items, Keys, pop, push
from dic.correlation.kernel.icgn import (
    CONVERGED,
    Float,
    Limits,
    Prepared,
    Workspace,
    correlate_point,
    workspace,
)
from dic.correlation.kernel.jit import compiled
from dic.correlation.kernel.layout import Deformed, Reference
from dic.correlation.kernel.moments import Shape, Taps
from dic.correlation.kernel.warps import extrapolate


def correlate_grid(
    image: Reference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    limits: Limits,
    xs: NDArray[np.int64],
    ys: NDArray[np.int64],
    pixels: NDArray[np.int64],
    seeds: NDArray[np.int64],
    warps: Float,
    std: Float,
    status: NDArray[np.int8],
    zncc: Float,
    iterations: NDArray[np.int16],
    pending: NDArray[np.bool_],
    spread: bool,
    prepared: Prepared | None = None,
) -> None:
    """Correlate the seeds from their own warps, then spread over the grid, always on from the highest ZNCC.

    A point that is reached starts from the warp of its neighbour, extrapolated; one that fails may be tried
    again from another side. Everything found is written in place.

    Parameters
    ----------
    xs, ys : ndarray, shapes (columns,) and (rows,)
        Coordinates of the grid, px.
    pixels : ndarray, shape (rows, columns)
        How many pixels of each subset lie in the region of interest.
    seeds : ndarray, shape (n, 2)
        Row and column on the grid.
    warps : ndarray, shape (rows, columns, 6 or 12)
    std : ndarray, shape (rows, columns, 6)
    status, zncc, iterations : ndarray, shape (rows, columns)
    pending : ndarray of bool, shape (rows, columns)
        Points that still want a value.
    spread : bool
        Whether to go on from the seeds and from all points that have converged before.
    prepared : Prepared, optional
        Of these points of this reference: filled, and used where it is filled. The results are the same.
    """
    # A point is queued at most once, except that seeds may have converged before.
    places = status.size + len(seeds) if spread else 0
    kept = prepared is not None
    _correlate_grid(
        image, deformed, taps, shape, limits, xs, ys, pixels, seeds,
        warps, std, status, zncc, iterations, pending, spread,
        kept, prepared or Prepared.empty((1, 1), len(shape)),
        workspace(limits.radius, len(shape)), np.empty(places), np.empty(places, np.int64),
    )  # fmt: skip


@compiled
def _correlate_grid(
    image: Reference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    limits: Limits,
    xs: NDArray[np.int64],
    ys: NDArray[np.int64],
    pixels: NDArray[np.int64],
    seeds: NDArray[np.int64],
    warps: Float,
    std: Float,
    status: NDArray[np.int8],
    zncc: Float,
    iterations: NDArray[np.int16],
    pending: NDArray[np.bool_],
    spread: bool,
    kept: bool,
    prepared: Prepared,
    work: Workspace,
    keys: Keys,
    queued: Items,
) -> None:
    """Do what `correlate_grid` promises, in memory that it has set aside."""
    rows, columns = status.shape
    start, queue = work.p, int(np.int64(0))  # not a literal, which would be a type of its own
    if spread:
        for place in range(rows * columns):
            row, column = place // columns, place % columns
            if status[row, column] == CONVERGED and not pending[row, column]:
                queue = push(keys, queued, queue, zncc[row, column], place)
    tasks = len(seeds)
    task, side, row, column = 0, 4, 0, 0
    while True:
        if task < tasks:
            i, j = seeds[task, 0], seeds[task, 1]
            task += 1
            for k in range(len(start)):
                start[k] = warps[i, j, k]
        else:
            if side == 4:
                if queue == 0:
                    return
                place = pop(keys, queued, queue)
                queue -= 1
                row, column, side = place // columns, place % columns, 0
            i = row + (side == 0) - (side == 1)
            j = column + (side == 2) - (side == 3)
            side += 1
            if i < 0 or j < 0 or i >= rows or j >= columns or not pending[i, j]:
                continue
            extrapolate(warps[row, column], xs[j] - xs[column], ys[i] - ys[row], start)
        at, to = (i, j) if kept else (0, 0)
        outcome, quality, count = correlate_point(
            image, deformed, taps, shape, limits, xs[j], ys[i], pixels[i, j], start, std[i, j],
            prepared.records[at, to], prepared.known[at, to], work,
        )  # fmt: skip
        prepared.known[at, to] = kept
        status[i, j], zncc[i, j], iterations[i, j] = outcome, quality, count
        pending[i, j] = outcome != CONVERGED
        if outcome == CONVERGED:
            for k in range(len(start)):
                warps[i, j, k] = start[k]
            if spread:
                queue = push(keys, queued, queue, quality, i * columns + j)
