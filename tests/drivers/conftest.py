"""What the driver tests share: a virtual clock, a context, and a watch over threads and file descriptors."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def context(clock: VirtualClock) -> OpenContext:
    return OpenContext("device", clock)


@pytest.fixture(autouse=True)
def nothing_is_left_open() -> Iterator[None]:
    threads = set(threading.enumerate())
    sockets = _sockets()
    yield
    assert set(threading.enumerate()) <= threads
    assert _sockets() <= sockets


def _sockets() -> set[str]:
    names = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            names.add(str(link.readlink()))
        except FileNotFoundError:
            continue
    return {name for name in names if name.startswith(("socket:", "pipe:", "/dev/pts", "/dev/ptmx"))}
