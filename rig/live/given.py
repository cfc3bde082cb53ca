"""Messages between a run and the process that measures its live gauges."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from rig.live.frame_ring import RingShape
from rig.live.job import LiveJob

READY, REFUSED, READING, FAILED = "ready", "refused", "reading", "failed"
"""The first words of the messages to the run: prepared; an error of the preparation; a reading; the end."""


@dataclass(frozen=True)
class Given:
    """The first message to the process: what to measure, and the descriptors that it inherits.

    Attributes
    ----------
    job : LiveJob
    rings : mapping of str to (RingShape, int)
        Shape and descriptor of the ring of each camera.
    control, wake : int
        Descriptors of the numbers that it tells, and of a pipe in which there is something after a new frame.
    """

    job: LiveJob
    rings: Mapping[str, tuple[RingShape, int]]
    control: int
    wake: int


@dataclass(frozen=True)
class Prepare:
    """The second message: images of the grid and of the reference, by camera."""

    grids: Mapping[str, NDArray[Any]]
    references: Mapping[str, NDArray[Any]]
