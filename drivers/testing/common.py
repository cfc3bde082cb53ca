"""Functions that the tests of all kinds of devices use."""

from collections.abc import Callable
from typing import TypeVar

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import DeviceInfo

Handle = Callable[[], object]
H = TypeVar("H")
Counter = Callable[[], int]

POLL_S = 0.05
LONGEST_S = 600.0


def needed(handle: H | None, what: str) -> H:
    """Return a function of the bench; skip the test if the function is None."""
    if handle is None:
        pytest.skip(f"this bench cannot {what}")
    return handle


def wait_until(done: Callable[[], bool], clock: Clock, within_s: float = LONGEST_S) -> None:
    """Wait until `done()` is true; fail if this takes longer than `within_s` seconds on `clock`."""
    end_s = clock.now_s() + within_s
    while not done():
        assert clock.now_s() < end_s, "the expected state was not reached in time"
        clock.sleep(POLL_S)


def assert_identified(info: DeviceInfo) -> None:
    """Check that a device reports vendor, model and serial number, which the run file contains."""
    assert info.vendor
    assert info.model
    assert info.serial


def assert_says_all(error: DeviceError) -> None:
    """Check that an error message gives device, step, expected and actual result, and remedy, in one line."""
    parts = (error.device, error.step, error.expected, error.got, error.remedy)
    assert all(parts)
    assert all(part in str(error) for part in parts)
    assert "\n" not in str(error)
