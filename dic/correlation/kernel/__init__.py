"""The compiled kernel: subset correlation at the speed of the processor.

Read it in this order: `layout` (how images lie in memory), `vectors` (what one instruction does), `moments`
(sums over a subset), `warps`, `icgn` (one point), `propagation` (many points, in the order of `heap`).
"""

from dic.correlation.kernel.icgn import Limits, Prepared, record_length
from dic.correlation.kernel.layout import Deformed, Reference, lay_coefficients, lay_reference
from dic.correlation.kernel.propagation import correlate_grid

__all__ = [
    "Deformed",
    "Limits",
    "Prepared",
    "Reference",
    "correlate_grid",
    "lay_coefficients",
    "lay_reference",
    "record_length",
]
