"""Helpers of the tests inside the virtual machine: access to the kernel's cameras, and a check for leaks."""

import fcntl
import os
from pathlib import Path
from typing import Any

from drivers.cameras.v4l2.abi import NEXT_CONTROL, ControlQuery, ControlValue, RequestCode
from drivers.cameras.v4l2.buffers import Filled
from drivers.cameras.v4l2.camera import V4l2Camera, open_camera
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.clock import SystemClock
from drivers.interfaces import OpenContext

CLOCK = SystemClock()
AT_START = {"timestamp_source": 1}
"""A control that makes the kernel's camera vivid timestamp the start of a frame.

Otherwise the timestamps of vivid lie in the future.
"""


OPENED: list[V4l2Camera] = []
"""Opened cameras, which are closed at the end of a failed test."""


def opened(device: str = "/dev/video0", **changes: Any) -> V4l2Camera:
    """Open a camera of the kernel; by default the camera vivid, with small pictures at 30 Hz."""
    values = {"device": device, "width_px": 320, "height_px": 180, "rate_hz": 30.0, "controls": AT_START}
    settings = V4l2Settings.model_validate(values | changes)
    camera = open_camera(settings, OpenContext("camera", CLOCK))
    OPENED.append(camera)
    return camera


def turn(knob: str, value: int = 0, camera: V4l2Camera | None = None, path: str = "/dev/video0") -> None:
    """Set a control of a camera, which has the kernel's name `knob`.

    If `camera` is filming, the control is set through the driver's file, because the driver lets no other
    file change the camera.
    """
    if camera is not None and camera._session is not None:
        _turn(camera._session._node._file, knob, value)  # type: ignore[attr-defined]
        return
    file = os.open(path, os.O_RDWR)
    try:
        _turn(file, knob, value)
    finally:
        os.close(file)


def _turn(file: int, knob: str, value: int) -> None:
    query = ControlQuery(id=NEXT_CONTROL)
    while query.name.decode() != knob:
        query.id |= NEXT_CONTROL
        fcntl.ioctl(file, RequestCode.QUERYCTRL, query)
    fcntl.ioctl(file, RequestCode.S_CTRL, ControlValue(id=query.id, value=value))


def watched(camera: V4l2Camera) -> list[Filled]:
    """Return a list to which the buffers are added that the kernel gives to the driver from now on."""
    session = camera._session
    assert session is not None
    assert session._buffers is not None
    take, seen = session._buffers.take, []

    def noting() -> Filled | None:
        filled = take()
        seen.extend([filled] if filled else [])
        return filled

    session._buffers.take = noting  # type: ignore[method-assign]
    return seen


def left_open() -> list[str]:
    """Return the open descriptors and memory mappings of video nodes in this process."""
    files = [str(path.readlink()) for path in Path("/proc/self/fd").iterdir() if path.is_symlink()]
    maps = Path("/proc/self/maps").read_text().splitlines()
    return [name for name in (*files, *maps) if "/dev/video" in name]
