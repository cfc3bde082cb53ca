"""A camera with the handles that its contract needs."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout
from drivers.interfaces import Camera, Frame
from drivers.testing.common import Counter, Handle, assert_says_all, needed

GRAB_S = 20.0
ROUNDS = 6
TINY_S = 1e-5
"""Tolerance for timestamps with a resolution of 1 µs."""


@dataclass(frozen=True)
class CameraBench:
    """A newly opened camera, with handles for the tests.

    Attributes
    ----------
    camera : Camera
    clock : Clock
        The clock of the frame times.
    name : str
        The camera's name in the rig file; errors must contain this name.
    interval_s : float
        Time between frames.
    reopen : callable
        ``reopen()`` opens the camera again with the same settings; the test closes the camera.
    exposure_us, gain : float
        As set; NaN if the camera does not report the value.
    tolerance_s : float
        Longest delay of a call after its deadline, and largest error of the date of a frame.
    shows : callable, optional
        ``shows(frame)`` returns the true start of exposure, from the picture alone.
    stall, go_on : callable, optional
        Stop the delivery of frames; start the delivery again.
    lose : callable, optional
        Lose the next frame, or some of the next frames.
    held : callable, optional
        ``held()`` returns the number of nodes and buffers that the driver has not released.
    """

    camera: Camera
    clock: Clock
    name: str
    interval_s: float
    reopen: Callable[[], Camera]
    exposure_us: float = math.nan
    gain: float = math.nan
    tolerance_s: float = 0.01
    shows: Callable[[Frame], float] | None = None
    stall: Handle | None = None
    go_on: Handle | None = None
    lose: Handle | None = None
    held: Counter | None = None

    def grab(self) -> Frame:
        """Grab a frame and assert, by timestamps and by picture, that its exposure began after the call."""
        asked_s = self.clock.now_s()
        frame = self.camera.grab(GRAB_S)
        assert asked_s <= frame.exposed_s <= frame.received_s <= self.clock.now_s()
        if self.shows is not None:
            begun_s = self.shows(frame)
            assert max(asked_s, frame.exposed_s) - TINY_S <= begun_s <= frame.received_s
        return frame

    def stream(self, **options: Any) -> Any:
        """Open a stream of all frames; skip the test if the driver has no streams."""
        return needed(getattr(self.camera, "stream", None), "stream")(**options)

    def assert_times_out(self, timeout_s: float) -> None:
        """Assert that `grab` raises `DeviceTimeout` in time, with a complete message."""
        asked_s = self.clock.now_s()
        with pytest.raises(DeviceTimeout) as late:
            self.camera.grab(timeout_s)
        allowed_s = timeout_s if timeout_s > 0 else 0.0  # NaN counts as 0
        assert self.clock.now_s() - asked_s <= allowed_s + self.tolerance_s
        self.assert_says_all(late.value)

    def assert_says_all(self, error: DeviceError) -> None:
        """Assert that an error is complete and names this camera."""
        assert_says_all(error)
        assert self.name in error.device
