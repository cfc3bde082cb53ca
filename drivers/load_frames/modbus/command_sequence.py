"""Sequence numbers of a load frame's commands. By them the machine ignores a motion command older than a
hold."""

import secrets
import threading
from collections import deque

MODULUS = 2**16
# A program's first sequence number exceeds the machine's number by at most this value. After the largest
# number the sequence starts again at 0, so a number that is ahead by more than half of the range would count
# as older. This limit is far below half of the range.
LEAP_MAX = 2**13
# Number of latest sequence numbers that a program remembers, because the machine may still execute them.
REMEMBERED = 64


class CommandSequence:
    """Sequence numbers for the commands of several threads, and the number of requested holds.

    The first sequence number has a random distance from the machine's number. Therefore two programs that
    command the same machine hardly ever use the same numbers. So each program notices the commands of the
    other.

    `executed` is the sequence number of the last command that the machine executed. `leap` is the distance of
    the first number from the number `executed`. By default it is random.
    """

    def __init__(self, executed: int, leap: int | None = None) -> None:
        self._lock = threading.Lock()
        leap = secrets.randbelow(LEAP_MAX) + 1 if leap is None else leap
        self._number = (executed + leap - 1) % MODULUS
        self._executed = executed
        self._ours: deque[int] = deque(maxlen=REMEMBERED)
        self._wrong = ""
        self._holds = 0

    @property
    def holds(self) -> int:
        """Number of holds that were requested so far."""
        return self._holds

    def begin_hold(self) -> None:
        """Record a requested hold. From now on, all motion commands that were begun earlier are refused."""
        with self._lock:
            self._holds += 1

    def draw(self) -> int:
        """Return the next sequence number."""
        with self._lock:
            return self._next()

    def draw_unless_held(self, holds: int, refusal: Exception) -> int:
        """Return the next number for a motion. Raise `refusal` if a hold was requested since the motion
        began."""
        with self._lock:
            if self._holds != holds:
                raise refusal
            return self._next()

    def follow(self, executed: int) -> None:
        """Continue from the number `executed` if another program has used newer numbers."""
        with self._lock:
            # do not change `_executed` here, because `check` may still receive an older reading than this one
            self._notice_foreign(executed)
            if 0 < (executed - self._number) % MODULUS < MODULUS // 2:
                self._number = executed

    def check(self, executed: int) -> None:
        """Check that the last executed command is of this program, and that its number has not decreased.

        A decreased number means that the machine has restarted, and has lost the limits that this program
        wrote. A 16-bit sample counter may not show a restart.

        Raise `ValueError` if the number has decreased, or is not a number of this program, because another
        program commands the machine. Every later check then fails too.
        """
        with self._lock:
            self._notice_foreign(executed)
            if not self._wrong and 0 < (self._executed - executed) % MODULUS <= MODULUS // 2:
                self._wrong = f"a restarted machine (command {executed} executed after {self._executed})"
            if self._wrong:
                raise ValueError(self._wrong)
            self._executed = executed

    def _notice_foreign(self, executed: int) -> None:
        newer = 0 < (executed - self._executed) % MODULUS < MODULUS // 2
        if newer and executed not in self._ours and not self._wrong:
            self._wrong = f"a command of another program, number {executed} after {self._executed}"

    def _next(self) -> int:
        self._number = (self._number + 1) % MODULUS
        self._ours.append(self._number)
        return self._number
