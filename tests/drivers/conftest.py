"""Fixtures for all tests of drivers: a virtual clock, a context, and a check for open threads and files."""

import threading
from collections.abc import Iterator

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from tests.open_lines import open_lines


@pytest.fixture
def context(clock: VirtualClock) -> OpenContext:
    return OpenContext("device", clock)


@pytest.fixture(autouse=True)
def nothing_is_left_open() -> Iterator[None]:
    threads = set(threading.enumerate())
    sockets = open_lines()
    yield
    assert set(threading.enumerate()) <= threads
    assert open_lines() <= sockets
