"""What the process of the live measurement tells at any time in a few numbers in shared memory."""

from typing import Any

import numpy as np

from rig.live.memory import SharedMemory

_SIZE = 4096
_PLACES = {"alive_s": 0, "left_out": 1}


class Control:
    """Two numbers that one process writes and another one reads.

    Attributes
    ----------
    alive_s : float
        Time on the system's clock at which the process last went on; 0 before it measures.
    left_out : int
        Number of frames that were not measured, because a newer one had come.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self.memory = SharedMemory(_SIZE, descriptor)
        buffer: Any = self.memory.buffer
        # Each number has eight bytes that are written at once.
        self._numbers = np.frombuffer(buffer, np.float64, len(_PLACES))

    @property
    def alive_s(self) -> float:
        """Time at which the process last went on."""
        return float(self._numbers[_PLACES["alive_s"]])

    @alive_s.setter
    def alive_s(self, time_s: float) -> None:
        self._numbers[_PLACES["alive_s"]] = time_s

    @property
    def left_out(self) -> int:
        """Number of frames that were not measured."""
        return int(self._numbers[_PLACES["left_out"]])

    @left_out.setter
    def left_out(self, count: int) -> None:
        self._numbers[_PLACES["left_out"]] = count
