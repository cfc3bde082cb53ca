"""Functions that the tests of all kinds of devices use."""

import math
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import DeviceInfo, Setting

Handle = Callable[[], object]
H = TypeVar("H")
Counter = Callable[[], int]

POLL_S = 0.05
LONGEST_S = 600.0
ANSWER_S = 30.0
"""Real time in which every call of a driver must return or raise."""


def needed(handle: H | None, what: str) -> H:
    """Return a function of the bench. Skip the test if the function is None."""
    if handle is None:
        pytest.skip(f"this bench cannot {what}")
    return handle


def wait_until(done: Callable[[], bool], clock: Clock, within_s: float = LONGEST_S) -> None:
    """Wait until `done()` is true. Fail if this takes longer than `within_s` seconds on `clock`."""
    end_s = clock.now_s() + within_s
    while not done():
        assert clock.now_s() < end_s, "the expected state was not reached in time"
        clock.sleep(POLL_S)


def assert_error_in_time(call: Callable[[], object], kind: type[DeviceError]) -> None:
    """Check that a call raises an error of this kind in time, with a complete message."""
    with ThreadPoolExecutor(1) as pool, pytest.raises(kind) as raised:
        pool.submit(call).result(ANSWER_S)
    assert_says_all(raised.value)


def assert_identified(info: DeviceInfo) -> None:
    """Check that a device reports vendor, model and serial number, which the run file contains."""
    assert info.vendor
    assert info.model
    assert info.serial


UNITS = (
    *("n", "mm", "n_s", "mm_s", "s", "us", "hz", "px", "bytes", "deg", "deg_s", "deg_s2", "v", "a"),
    *("per_deg", "per_mm", "raw"),
)
"""Units at the end of the names of settings that are floats. ``raw`` means the device's own unit."""
RATIOS = ("gain",)
NAME_MAX, TEXT_MAX, SETTINGS_MAX = 64, 200, 100


def assert_settings(read: Callable[[], dict[str, Setting]]) -> dict[str, Setting]:
    """Check that the settings of a device fit the run file and are repeatable. Return the settings.

    A name has lower-case letters, digits and underscores. The name of a float ends with a unit. A text is one
    line.
    """
    found = read()
    assert 0 < len(found) <= SETTINGS_MAX
    for name, value in found.items():
        assert re.fullmatch("[a-z][a-z0-9_]*", name)
        assert len(name) <= NAME_MAX
        assert type(value) in (str, float, int, bool), f"{name} is a {type(value).__name__}"
        if isinstance(value, float):
            assert math.isfinite(value), f"{name} is {value}"
            assert name in RATIOS or name.endswith(tuple(f"_{unit}" for unit in UNITS)), f"{name} has no unit"
        if isinstance(value, str):
            assert len(value) <= TEXT_MAX
            assert value.isprintable()
    assert read() == found, "a setting changed from one reading to the next"
    return found


def assert_says_all(error: DeviceError) -> None:
    """Check that an error message gives device, step, expected and actual result, and remedy, in one line."""
    parts = (error.device, error.step, error.expected, error.got, error.remedy)
    assert all(parts)
    assert all(part in str(error) for part in parts)
    assert "\n" not in str(error)
