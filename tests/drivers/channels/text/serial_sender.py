"""An instrument's end of a serial line, for tests that send lines by themselves."""

import os
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager


class Sender:
    """The instrument's end of a serial line."""

    def __init__(self) -> None:
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.path = os.ttyname(self._far)

    def say(self, *lines: str, end: str = "\r\n") -> None:
        os.write(self._near, "".join(line + end for line in lines).encode())

    def heard(self, count: int) -> bytes:
        received = b""
        while len(received) < count:
            received += os.read(self._near, 4096)
        return received

    def close(self) -> None:
        for descriptor in (self._near, self._far):
            os.close(descriptor)

    @contextmanager
    def saying_soon(self, *lines: str) -> Iterator[None]:
        """Say lines a little later, because opening a port discards what came before."""
        speaking = threading.Timer(0.1, self.say, lines)
        speaking.start()
        try:
            yield
        finally:
            speaking.join()
