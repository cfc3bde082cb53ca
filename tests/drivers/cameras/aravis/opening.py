"""Open the Aravis driver on a simulated library, with the settings that all its tests use."""

from drivers.cameras.aravis.camera import AravisCamera
from drivers.cameras.aravis.settings import AravisSettings
from drivers.interfaces import OpenContext
from tests.drivers.cameras.fake_aravis import HEIGHT, INTERVAL_S, WIDTH, FakeLibrary

DEADLINE_S = 60.0
"""Deadline in s of real time for work on other threads. Only a failing test waits for so long."""


def settings(**changes: object) -> AravisSettings:
    values = {
        "camera": "G1",
        "format": "Mono12",
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "rate_hz": 1 / INTERVAL_S,
        "exposure_us": 5000.0,
        "gain": 2.0,
    }
    return AravisSettings.model_validate(values | changes)


def opened(library: FakeLibrary, context: OpenContext, **changes: object) -> AravisCamera:
    return AravisCamera(settings(**changes), context, library)  # type: ignore[arg-type]
