"""The bench for tests of a camera driver: an opened camera, and functions that cause faults."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout
from drivers.interfaces import Camera, Frame
from drivers.testing.common import Counter, Handle, assert_says_all, needed

GRAB_S = 20.0
ROUNDS = 6
TINY_S = 1e-5
"""Tolerance, in seconds, for timestamps that have a resolution of 1 µs."""


@dataclass(frozen=True)
class CameraBench:
    """A newly opened camera, with functions that the tests use to cause faults.

    Attributes
    ----------
    camera : Camera
    clock : Clock
        The rig's clock, on which `exposed_s` and `received_s` of the frames are measured.
    name : str
        The camera's name in the rig file. Every error message must contain this name.
    interval_s : float
        Time between two frames, in seconds.
    reopen : callable
        ``reopen()`` opens the camera again with the same settings. The test then closes the camera.
    exposure_us, gain : float
        The exposure time in µs and the gain in the settings, or NaN if the camera does not report the value.
    tolerance_s : float
        A call of the camera may end this number of seconds after its deadline. The times `exposed_s` and
        `utc` of a frame may differ by this number of seconds.
    shows : callable, optional
        ``shows(frame)`` returns the true start of exposure, which a test camera has drawn into the picture.
    stall, go_on : callable, optional
        ``stall()`` stops the delivery of frames, and ``go_on()`` starts the delivery again.
    lose : callable, optional
        ``lose()`` makes the camera lose the next frame, or some of the next frames.
    held : callable, optional
        ``held()`` returns the number of device nodes and buffers that the driver has not yet released.
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
        """Grab a frame; check with its times and its picture that the exposure began after the call."""
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
        """Check that `grab` raises `DeviceTimeout` at the deadline, with a complete message."""
        assert self.times_out(timeout_s)

    def times_out(self, timeout_s: float) -> bool:
        """Return whether `grab` raises `DeviceTimeout` at the deadline, not giving a frame before it."""
        asked_s, timed_out = self.clock.now_s(), False
        try:
            frame = self.camera.grab(timeout_s)
        except DeviceTimeout as late:
            self.assert_says_all(late)
            timed_out = True
        else:
            assert asked_s <= frame.exposed_s
        allowed_s = timeout_s if timeout_s > 0 else 0.0  # treat a timeout of NaN as 0
        assert self.clock.now_s() - asked_s <= allowed_s + self.tolerance_s
        return timed_out

    def assert_says_all(self, error: DeviceError) -> None:
        """Check that an error message gives device, step, expected and actual result, and remedy."""
        assert_says_all(error)
        assert self.name in error.device
