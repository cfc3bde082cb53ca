"""Correlate the points of a grid: start points, and the neighbours of converged points.

Only numba needs this module and the modules that it imports, and only to compile them. Programs call
`dic.correlation.kernel.propagation`.
"""

import numpy as np

from dic.correlation.kernel.heap import Queue, pop, push
from dic.correlation.kernel.icgn import CONVERGED, correlate_point
from dic.correlation.kernel.layout import Deformed, KernelReference
from dic.correlation.kernel.method import Method, Subset
from dic.correlation.kernel.records import Prepared
from dic.correlation.kernel.solution import KernelGrid, Solution, Task
from dic.correlation.kernel.warps import extrapolate
from dic.correlation.kernel.workspace import Workspace


def correlate_grid(
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
