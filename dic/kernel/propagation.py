"""Many points: scattered ones, and grids by reliability-guided propagation.

Points of a grid are visited from the best outwards: B. Pan, "Reliability-guided digital image correlation for
image deformation measurement", Applied Optics 48 (2009) 1535-1542.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from dic.kernel.icgn import CONVERGED, Flat, Float, Limits, correlate_point, extrapolate, workspace
from dic.kernel.jit import compiled
from dic.kernel.layout import Reference
from dic.kernel.moments import Shape, Taps


@compiled
def correlate_points(
    image: Reference,
    c: Flat,
    taps: Taps,
    shape: Shape,
    limits: Limits,
    points: NDArray[np.int64],
    pixels: NDArray[np.int64],
    warps: Float,
    deviations: Float,
    status: NDArray[np.int8],
    zncc: Float,
    iterations: NDArray[np.int16],
) -> None:
    """Correlate `points` (n, 2), each from its own warp in `warps` (n, 6 or 12).

    `pixels` (n,) tells how many pixels of each subset lie in the region of interest. Results are written in
    place: warps, `deviations` (n, 6), `status`, `zncc` and `iterations` (n,).
    """
    work = workspace(limits.radius, shape)
    for k in range(len(points)):
        status[k], zncc[k], iterations[k] = correlate_point(
            image,
            c,
            taps,
            shape,
            limits,
            points[k, 0],
            points[k, 1],
            pixels[k],
            warps[k],
            deviations[k],
            work,
        )


@compiled
def propagate(
    image: Reference,
    c: Flat,
    taps: Taps,
    shape: Shape,
    limits: Limits,
    xs: NDArray[np.int64],
    ys: NDArray[np.int64],
    pixels: NDArray[np.int64],
    warps: Float,
    deviations: Float,
    status: NDArray[np.int8],
    zncc: Float,
    iterations: NDArray[np.int16],
    pending: NDArray[np.bool_],
) -> None:
    """Spread over the grid of points from those already converged, always continuing at the highest ZNCC.

    `xs` (columns), `ys` (rows) are the grid's coordinates; `warps` (rows, columns, 6 or 12), `deviations`
    (rows, columns, 6), `status`, `zncc`, `iterations` and `pending` (rows, columns) are updated in place. A
    neighbour starts from the warp of the point that reached it, extrapolated by its gradients; one that fails
    may be tried again from another side.
    """
    rows, columns = status.shape
    work = workspace(limits.radius, shape)
    heap = [(0.0, 0, 0)][:0]
    for row in range(rows):
        for column in range(columns):
            if status[row, column] == CONVERGED:
                heapq.heappush(heap, (-zncc[row, column], row, column))
    start = np.empty(len(shape))
    while len(heap) > 0:
        _, row, column = heapq.heappop(heap)
        for side in range(4):
            i = row + (side == 0) - (side == 1)
            j = column + (side == 2) - (side == 3)
            if i < 0 or j < 0 or i >= rows or j >= columns or not pending[i, j]:
                continue
            dx, dy = xs[j] - xs[column], ys[i] - ys[row]
            extrapolate(warps[row, column], dx, dy, start)
            outcome, quality, count = correlate_point(
                image, c, taps, shape, limits, xs[j], ys[i], pixels[i, j], start, deviations[i, j], work
            )
            status[i, j], zncc[i, j], iterations[i, j] = outcome, quality, count
            if outcome == CONVERGED:
                warps[i, j] = start
                pending[i, j] = False
                heapq.heappush(heap, (-quality, i, j))
