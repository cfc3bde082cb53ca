"""The compiled kernel: IC-GN (inverse compositional Gauss-Newton) for every point of a grid.

docs/kernel.md derives the sums that the kernel computes. Read docs/kernel.md first, then the modules in this
order: `method`, `layout`, `coefficients` and `part` (images in memory), `warps`, `vectors` and `unrolled`
(processor vectors), `bspline_weights`, `moments` (sums over a subset), `prepared` (data of the reference's
subset), `icgn` (one point), `uncertainty` (standard deviations), `grid` and `propagation` (many points). They
are compiled by `jit`.
"""

from dic.correlation.kernel.coefficients import lay_deformed
from dic.correlation.kernel.layout import (
    Deformed,
    KernelReference,
    flat_variance_of,
    lay_reference,
)
from dic.correlation.kernel.method import NOT_LAID, ROOM_PX, Method
from dic.correlation.kernel.part import Part, PartMemory, part_of_reference
from dic.correlation.kernel.propagation import correlate_seeds, propagate
from dic.correlation.kernel.records import Prepared, record_length
from dic.correlation.kernel.solution import KernelGrid, Solution
from dic.correlation.kernel.warps import EDGE_PX

__all__ = [
    "EDGE_PX",
    "NOT_LAID",
    "ROOM_PX",
    "Deformed",
    "KernelGrid",
    "KernelReference",
    "Method",
    "Part",
    "PartMemory",
    "Prepared",
    "Solution",
    "correlate_seeds",
    "flat_variance_of",
    "lay_deformed",
    "lay_reference",
    "part_of_reference",
    "propagate",
    "record_length",
]
