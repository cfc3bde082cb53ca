"""Order of requests on a line that carries one request at a time: urgent requests go first."""

import contextlib
import os
import threading
from collections.abc import Iterator


class Turn:
    """One request at a time.

    A thread that waits for an ordinary answer watches `wake`. An urgent request makes `wake` readable, and
    the thread must then end its wait. No ordinary request begins while an urgent request waits.

    Attributes
    ----------
    wake : int
        A file descriptor.
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
        """Wait for the end of every other request, then hold the turn."""
        with self._changed:
            self._changed.wait_for(lambda: not self._taken and not self._urgent)
            self._taken = True
        try:
            yield
        finally:
            self._release()

    @contextlib.contextmanager
    def urgent(self) -> Iterator[None]:
        """End the wait of an ordinary request under way, then hold the turn."""
        with self._changed:
            self._urgent += 1
        try:
            self._overtake()
            try:
                yield
            finally:
                self._release()
        finally:
            # also after an exception during the wait; otherwise ordinary requests would wait for ever
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
        """Release the descriptors; harmless when repeated. No thread may be waiting."""
        with self._changed:
            if not self._closed:
                self._closed = True
                os.close(self.wake)
                os.close(self._waker)
