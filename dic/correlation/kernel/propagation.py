"""Correlate many points: start points from first guesses, and the other points by propagation.

Propagation always continues from the most reliable point, which has the highest ZNCC (B. Pan,
"Reliability-guided digital image correlation for image deformation measurement", Applied Optics 48 (2009)
1535-1542).
"""

from typing import NamedTuple

import numpy as np

from dic.correlation.kernel.heap import Queue, pop, push
from dic.correlation.kernel.icgn import CONVERGED, correlate_point
from dic.correlation.kernel.jit import compiled
from dic.correlation.kernel.layout import Deformed, KernelReference
from dic.correlation.kernel.method import Method, Subset
from dic.correlation.kernel.prepared import Prepared
from dic.correlation.kernel.solution import KernelGrid, Solution
from dic.correlation.kernel.warps import extrapolate
from dic.correlation.kernel.workspace import Workspace
from dic.typing import Indices, Mask


class Task(NamedTuple):
    """The points of a grid that are to be solved."""

    seeds: Indices
    """Shape (n, 2). Row and column of points that start from their own warps."""
    propagates: bool
    """True to continue from the converged points to their neighbours."""
    pending: Mask
    """Shape (rows, columns). True for points that are still to be solved."""


def correlate_seeds(
    image: KernelReference,
    deformed: Deformed,
    method: Method,
    grid: KernelGrid,
    seeds: Indices,
    solution: Solution,
) -> None:
    """Correlate start points (rows and columns, (n, 2)) from their warps in `solution`; update `solution`."""
    task = Task(seeds, False, np.ones(solution.status.shape, np.bool_))
    _run(image, deformed, method, grid, solution, task, None)


def propagate(
    image: KernelReference,
    deformed: Deformed,
    method: Method,
    grid: KernelGrid,
    solution: Solution,
    pending: Mask,
    prepared: Prepared | None = None,
) -> None:
    """Solve pending points from their converged neighbours, in the order of decreasing ZNCC.

    A pending point starts from the extrapolated warp of its neighbour. A point that fails is tried again from
    its other neighbours.

    `solution`: the solution of the grid, which is updated in place. `pending`, shape (rows, columns): True
    for points that are still to be solved. Elements of converged points are set to False. `prepared`:
    prepared data of the reference's subsets. Known records are used, and unknown records are filled. The
    results of the correlation do not depend on prepared data.
    """
    task = Task(np.empty((0, 2), np.int64), True, pending)
    _run(image, deformed, method, grid, solution, task, prepared)


def _run(
    image: KernelReference,
    deformed: Deformed,
    method: Method,
    grid: KernelGrid,
    solution: Solution,
    task: Task,
    prepared: Prepared | None,
) -> None:
    parameters = len(method.shape)
    work = Workspace.for_subsets(method.radius, parameters)
    # The size of the grid is enough, because a point is queued only once, when it converges.
    queue = Queue.with_room_for(solution.status.size if task.propagates else 0)
    kept = prepared or Prepared.empty((1, 1), parameters)
    _correlate_grid(image, deformed, method, grid, solution, task, kept, work, queue)


@compiled
def _correlate_grid(
    image: KernelReference,
    deformed: Deformed,
    method: Method,
    grid: KernelGrid,
    solution: Solution,
    task: Task,
    prepared: Prepared,
    work: Workspace,
    queue: Queue,
) -> None:
    """Solve the points of a task; `prepared` has one record for each point, or one record for all points."""
    rows, columns = solution.status.shape
    pending, warps, start = task.pending, solution.warps, work.p
    kept = prepared.known.shape == solution.status.shape
    size = int(np.int64(0))  # numba gives a literal 0 another type than int64
    if task.propagates:
        for place in range(rows * columns):
            row, column = place // columns, place % columns
            if solution.status[row, column] == CONVERGED and not pending[row, column]:
                size = push(queue, size, solution.zncc[row, column], place)
    seed, side, row, column = 0, 4, 0, 0
    while True:
        if seed < len(task.seeds):
            i, j = task.seeds[seed, 0], task.seeds[seed, 1]
            seed += 1
            for k in range(len(start)):
                start[k] = warps[i, j, k]
        else:
            if side == 4:
                if size == 0:
                    return
                place = pop(queue, size)
                size -= 1
                row, column, side = place // columns, place % columns, 0
            i = row + (side == 0) - (side == 1)
            j = column + (side == 2) - (side == 3)
            side += 1
            if i < 0 or j < 0 or i >= rows or j >= columns or not pending[i, j]:
                continue
            extrapolate(warps[row, column], grid.x[j] - grid.x[column], grid.y[i] - grid.y[row], start)
        at, to = (i, j) if kept else (0, 0)
        subset = Subset(grid.x[j], grid.y[i], method.radius, grid.pixels[i, j])
        outcome, zncc, iterations = correlate_point(
            image, deformed, method, subset, start, solution.std[i, j],
            prepared.records[at, to], prepared.known[at, to], work,
        )  # fmt: skip
        prepared.known[at, to] = kept
        solution.status[i, j], solution.zncc[i, j], solution.iterations[i, j] = outcome, zncc, iterations
        pending[i, j] = outcome != CONVERGED
        if outcome == CONVERGED:
            for k in range(len(start)):
                warps[i, j, k] = start[k]
            if task.propagates:
                size = push(queue, size, zncc, i * columns + j)
