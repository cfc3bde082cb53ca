"""The parts of an earlier image's field with which the correlation of an image begins."""

from dataclasses import dataclass
from typing import Self

from dic.correlation.field import Field
from dic.correlation.seeds import scattered
from dic.typing import Float, Mask


@dataclass(frozen=True, eq=False)
class EarlierField:
    """The parts of an earlier image's field with which the correlation of an image begins.

    They are much smaller than the field, so they can be kept for several images and sent to other processes.
    """

    warps: Float
    """Shape (n, 6). The warps of the points that are tried as seeds: of `scattered`, in the same order."""
    converged: Mask
    """Shape (rows, columns). True for the converged points."""

    @classmethod
    def of(cls, field: Field) -> Self:
        """Return these parts of a field."""
        rows, columns = scattered(field.active).T
        return cls(field.warps[rows, columns, :6], field.converged)
