"""Order of requests from several threads on one line. One request uses it at a time, urgent ones first."""

import contextlib
import os
import threading
from collections.abc import Iterator


class RequestTurn:
    """Lock of a serial or TCP line. One request at a time uses the line, and urgent requests go first.

    A thread that waits for the answer to an ordinary request must also watch the file descriptor `wake`. An
    urgent request makes `wake` readable, and the waiting thread must then end its wait. No ordinary request
    begins while an urgent request waits. `wake` is the file descriptor that becomes readable when an urgent
    request waits for the line.
    """

    def __init__(self) -> None:
        self.wake, self._waker = os.pipe()
        os.set_blocking(self.wake, False)
        self._changed = threading.Condition()
        self._taken = False
        self._urgent = 0
        self._closed = False

    @contextlib.contextmanager
    def ordinary(self) -> Iterator[None]:
        """Wait until the line is free and no urgent request waits, then reserve the line."""
        with self._changed:
            self._changed.wait_for(lambda: not self._taken and not self._urgent)
            self._taken = True
        try:
            yield
        finally:
            self._release()

    @contextlib.contextmanager
    def urgent(self) -> Iterator[None]:
        """Interrupt an ordinary request that waits for its answer, then reserve the line."""
        with self._changed:
            self._urgent += 1
        try:
            self._overtake()
            try:
                yield
            finally:
                self._release()
        finally:
            # count this urgent request as finished also after an exception, or ordinary requests would wait
            # for ever
            with self._changed:
                self._urgent -= 1
                self._changed.notify_all()

    def _overtake(self) -> None:
        with self._changed:
            if not self._closed:
                os.write(self._waker, b"!")
            self._changed.wait_for(lambda: not self._taken)
            self._taken = True
            if not self._closed:
                with contextlib.suppress(BlockingIOError):
                    os.read(self.wake, 64)

    def _release(self) -> None:
        with self._changed:
            self._taken = False
            self._changed.notify_all()

    def close(self) -> None:
        """Close both file descriptors, when no thread waits any more. A repeated call has no effect."""
        with self._changed:
            if not self._closed:
                self._closed = True
                os.close(self.wake)
                os.close(self._waker)
