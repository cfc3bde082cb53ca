"""A camera, and what its contract needs besides."""

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
"""Stamps count microseconds."""


@dataclass(frozen=True)
class CameraBench:
    """A camera that was just opened, and what can be done to it.

    Attributes
    ----------
    camera : Camera
    clock : Clock
        The clock of its frames' times.
    name : str
        The camera's name in the rig file, which errors must tell.
    interval_s : float
        From one frame to the next.
    reopen : callable
        ``reopen()`` opens the camera once more, as it was; the test closes it.
    exposure_us, gain : float
        As set; NaN where the camera does not tell them.
    tolerance_s : float
        How long after its deadline a call may end, and by how much the date of a frame may be wrong.
    shows : callable, optional
        ``shows(frame)`` tells by the picture alone when its exposure truly began.
    stall, go_on : callable, optional
        From now on the camera gives no frames; and it does again.
    lose : callable, optional
        The next frame is lost, or some of the next are.
    held : callable, optional
        ``held()`` counts what the driver has not released of the camera: its nodes, its buffers.
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
        """Grab a frame that was exposed after the call, by its stamps and by its picture."""
        asked_s = self.clock.now_s()
        frame = self.camera.grab(GRAB_S)
        assert asked_s <= frame.exposed_s <= frame.received_s <= self.clock.now_s()
        if self.shows is not None:
            begun_s = self.shows(frame)
            assert max(asked_s, frame.exposed_s) - TINY_S <= begun_s <= frame.received_s
        return frame

    def stream(self, **options: Any) -> Any:
        """Open a stream of all frames; the test is skipped where the driver has none."""
        return needed(getattr(self.camera, "stream", None), "stream")(**options)

    def assert_times_out(self, timeout_s: float) -> None:
        """A frame that cannot come in time is given up in time, in one sentence."""
        asked_s = self.clock.now_s()
        with pytest.raises(DeviceTimeout) as late:
            self.camera.grab(timeout_s)
        allowed_s = timeout_s if timeout_s > 0 else 0.0  # NaN counts as none
        assert self.clock.now_s() - asked_s <= allowed_s + self.tolerance_s
        self.assert_says_all(late.value)

    def assert_says_all(self, error: DeviceError) -> None:
        """An error names this camera."""
        assert_says_all(error)
        assert self.name in error.device
