"""The other end of a simulated device on a terminal."""

import os
import select
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def terminal_of(address: str) -> Iterator[int]:
    """Open a device's terminal, as a descriptor."""
    terminal = os.open(address, os.O_RDWR | os.O_NOCTTY)
    try:
        yield terminal
    finally:
        os.close(terminal)


def listen(terminal: int, size: int) -> bytes:
    """Return what comes, `size` bytes and whatever follows them; fewer if nothing comes for 10 s."""
    received = b""
    while select.select([terminal], [], [], 10.0 if len(received) < size else 0.05)[0]:
        received += os.read(terminal, 300)
    return received
