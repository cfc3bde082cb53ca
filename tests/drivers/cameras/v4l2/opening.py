"""Open the V4L2 driver on a simulated kernel's camera, with the settings that all its tests use."""

from drivers.cameras.v4l2.camera import V4l2Camera, open_camera
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.interfaces import OpenContext
from tests.drivers.cameras.fake_kernel import FakeCamera, FakeSystem

EXPOSURE_US = 10_000.0


def settings(**changes: object) -> V4l2Settings:
    values = {
        "device": "/dev/video0",
        "format": "Y12",
        "width_px": 32,
        "height_px": 20,
        "rate_hz": 32.0,
        "exposure_us": EXPOSURE_US,
        "gain": 4,
        "transfer_us": 0.0,
    }
    return V4l2Settings.model_validate(values | changes)


def opened(plugged: FakeCamera, context: OpenContext, **changes: object) -> V4l2Camera:
    return open_camera(settings(**changes), context, FakeSystem([plugged]))
