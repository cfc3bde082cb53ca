"""What the tests inside the virtual machine share: hands on the kernel's cameras, and a watch for leaks."""

import fcntl
import os
from pathlib import Path
from typing import Any

from drivers.cameras.v4l2.abi import NEXT_CONTROL, ControlQuery, ControlValue, Request
from drivers.cameras.v4l2.buffers import Filled
from drivers.cameras.v4l2.camera import V4l2Camera, open_camera
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.clock import SystemClock
from drivers.interfaces import OpenContext

CLOCK = SystemClock()
AT_START = {"timestamp_source": 1}
"""Lets vivid stamp a frame when it begins it; otherwise its stamps lie in the future."""


OPENED: list[V4l2Camera] = []
"""To be closed by the end of a test that failed."""


def opened(device: str = "/dev/video0", **changes: Any) -> V4l2Camera:
    """Open a camera of the kernel; by default vivid's small picture at 30 Hz."""
    values = {"device": device, "width_px": 320, "height_px": 180, "rate_hz": 30.0, "controls": AT_START}
    settings = V4l2Settings.model_validate(values | changes)
    camera = open_camera(settings, OpenContext("camera", CLOCK))
    OPENED.append(camera)
    return camera


def turn(knob: str, value: int = 0, camera: V4l2Camera | None = None, path: str = "/dev/video0") -> None:
    """Set one of the kernel's controls, named as the kernel does.

    Through the file of the `camera` that films: the driver claims it, and no other may touch it then.
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
        fcntl.ioctl(file, Request.QUERYCTRL, query)
    fcntl.ioctl(file, Request.S_CTRL, ControlValue(id=query.id, value=value))


def watched(camera: V4l2Camera) -> list[Filled]:
    """The buffers that the kernel gives the driver from now on, in their order."""
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
    """Descriptors and mappings of video nodes that this process holds."""
    files = [str(path.readlink()) for path in Path("/proc/self/fd").iterdir() if path.is_symlink()]
    maps = Path("/proc/self/maps").read_text().splitlines()
    return [name for name in (*files, *maps) if "/dev/video" in name]
