"""Open the pseudo-terminal of a simulated device, and read from it."""

import os
import select
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def terminal_of(address: str) -> Iterator[int]:
    """Open a device's pseudo-terminal, and yield its descriptor."""
    terminal = os.open(address, os.O_RDWR | os.O_NOCTTY)
    try:
        yield terminal
    finally:
        os.close(terminal)


def listen(terminal: int, size: int) -> bytes:
    """Return `size` received bytes and any further bytes; fewer bytes if none come for 10 s."""
    received = b""
    while select.select([terminal], [], [], 10.0 if len(received) < size else 0.05)[0]:
        received += os.read(terminal, 300)
    return received
