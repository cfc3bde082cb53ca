"""Sequence numbers of a load frame's commands: each is newer; a hold invalidates older motion."""

import threading

MODULUS = 2**16


class CommandSequence:
    """Sequence numbers for several threads, and the number of holds requested.

    Parameters
    ----------
    executed : int
        The number of the last command the machine executed.
    """

    def __init__(self, executed: int) -> None:
        self._lock = threading.Lock()
        self._number = executed
        self._executed = executed
        self._restarted = False
        self._holds = 0

    @property
    def holds(self) -> int:
        """Number of holds requested."""
        return self._holds

    def begin_hold(self) -> None:
        """Refuse from now on all motion commands that were begun earlier."""
        with self._lock:
            self._holds += 1

    def draw(self) -> int:
        """Take the next number."""
        with self._lock:
            return self._next()

    def draw_unless_held(self, holds: int, refusal: Exception) -> int:
        """Take the next number for a motion; raise the refusal if `holds` has changed."""
        with self._lock:
            if self._holds != holds:
                raise refusal
            return self._next()

    def follow(self, executed: int) -> None:
        """Continue from the machine's number if another program has used newer numbers."""
        with self._lock:
            if 0 < (executed - self._number) % MODULUS < MODULUS // 2:
                self._number = executed

    def check(self, executed: int) -> None:
        """Compare the machine's number with the last one seen.

        A restarted machine has its own limits again, and a 16-bit sample counter may not show the restart.

        Raises
        ------
        ValueError
            If the number has gone back, which means a restart of the machine; every later check then fails.
        """
        with self._lock:
            self._restarted |= 0 < (self._executed - executed) % MODULUS < MODULUS // 2
            if self._restarted:
                raise ValueError(f"a restarted machine (command {executed} executed after {self._executed})")
            self._executed = executed

    def _next(self) -> int:
        self._number = (self._number + 1) % MODULUS
        return self._number
