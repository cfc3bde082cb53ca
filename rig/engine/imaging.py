"""Take one image, and check that it is fresh, whole and of the announced format."""

from collections.abc import Callable

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Camera, Frame

_ATTEMPTS = 3


def take_image(
    name: str, camera: Camera, *, timeout_s: float, clock: Clock, step: str, warn: Callable[[str], None]
) -> Frame:
    """Return a frame exposed after this call and without error flags.

    A flagged frame is reported by `warn` and taken again, at most three times in all.

    Raises
    ------
    DeviceError
        If the camera fails, or its frames are stale, flagged or of another format than it announced.
    """
    for _ in range(_ATTEMPTS):
        asked_s = clock.now_s()
        frame = camera.grab(timeout_s)
        _require_fresh(name, frame, asked_s, step)
        _require_format(name, camera, frame, step)
        if frame.flags == 0:
            return frame
        warn(f"cameras.{name}: {step}: image with flags {frame.flags:#x} dropped")
    raise DeviceFault(
        f"cameras.{name}",
        step,
        "an image without error flags",
        f"{_ATTEMPTS} flagged images, the last with {frame.flags:#x}",
        "check the camera's cable, or let fewer cameras share its bus",
    )


def _require_fresh(name: str, frame: Frame, asked_s: float, step: str) -> None:
    if frame.exposed_s < asked_s:
        raise DeviceFault(
            f"cameras.{name}",
            step,
            "an image exposed after it was asked for",
            f"one exposed {asked_s - frame.exposed_s:.3f} s before",
            "use a driver that discards waiting images, such as v4l2 or aravis",
        )


def _require_format(name: str, camera: Camera, frame: Frame, step: str) -> None:
    info = camera.info
    dtype = np.uint8 if info.bits <= 8 else np.uint16
    shape = (info.height_px, info.width_px)
    if frame.image.shape != shape or frame.image.dtype != dtype:
        raise DeviceFault(
            f"cameras.{name}",
            step,
            f"an image of {shape[1]} x {shape[0]} px as {np.dtype(dtype)}",
            f"shape {frame.image.shape} as {frame.image.dtype}",
            "mend the driver, which announces a format that it does not deliver",
        )
