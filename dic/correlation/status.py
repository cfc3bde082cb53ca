"""The status of a point of interest: converged, or the reason why the point failed."""

from enum import IntEnum


class Status(IntEnum):
    """The status of a point: CONVERGED, or the reason why the point has no value.

    The numbers of the status values are compiled into the kernel and stored in result files, so they must not
    change.
    """

    CONVERGED = 0
    NOT_REACHED = 1
    NO_TEXTURE = 2
    OUT_OF_VIEW = 3
    NOT_CONVERGED = 4
    LOW_CORRELATION = 5
    INCONSISTENT = 6
    REPEATING = 7

    @property
    def text(self) -> str:
        """The status as text for files and tables, such as "not reached"."""
        return self.name.lower().replace("_", " ")
