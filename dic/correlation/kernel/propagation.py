"""Correlate many points: start points from first guesses, and the other points by propagation.

Propagation always continues from the most reliable point, which has the highest ZNCC (B. Pan,
"Reliability-guided digital image correlation for image deformation measurement", Applied Optics 48 (2009)
1535-1542).
"""

import numpy as np

from dic.correlation.kernel.heap import Queue
from dic.correlation.kernel.jit import compiled_in
from dic.correlation.kernel.layout import Deformed, KernelReference
from dic.correlation.kernel.method import Method
from dic.correlation.kernel.records import Prepared
from dic.correlation.kernel.solution import KernelGrid, Solution, Task
from dic.correlation.kernel.workspace import Workspace
from dic.typing import Indices, Mask

_correlate_grid = compiled_in("dic.correlation.kernel.grid", "correlate_grid")


def correlate_seeds(
    image: KernelReference,
    deformed: Deformed,
    method: Method,
    grid: KernelGrid,
    seeds: Indices,
    solution: Solution,
    prepared: Prepared | None = None,
) -> None:
    """Correlate start points (rows and columns, (n, 2)) from their warps in `solution`; update `solution`.

    `prepared` is as for `propagate`.
    """
    task = Task(seeds, False, np.ones(solution.status.shape, np.bool_))
    _run(image, deformed, method, grid, solution, task, prepared)


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
