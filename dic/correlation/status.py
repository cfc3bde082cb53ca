"""Why a point of interest has a value, or none; compiled into the kernel, and written to files."""

from enum import IntEnum


class Status(IntEnum):
    """Why a point has a value, or none."""

    CONVERGED = 0
    NOT_REACHED = 1
    NO_TEXTURE = 2
    OUT_OF_VIEW = 3
    NOT_CONVERGED = 4
    LOW_CORRELATION = 5
    INCONSISTENT = 6

    @property
    def text(self) -> str:
        """The status as files and tables say it."""
        return self.name.lower().replace("_", " ")
