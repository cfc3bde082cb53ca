"""A simulated GenTL producer for the tests of the driver, with a camera that films on the virtual clock.

All pixels of a picture have the picture's number as grey level. The producer keeps the oldest frames that
nobody has taken, as producers do, and loses the frames for which no buffer is free.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from drivers.cameras.gentl.camera import GentlCamera
from drivers.cameras.gentl.device import GentlError, Picture
from drivers.cameras.gentl.producers import Listed
from drivers.cameras.gentl.settings import GentlSettings
from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext

WIDTH, HEIGHT, INTERVAL_S = 32, 16, 1 / 32
EXPOSURE_S, TRANSFER_S = 0.005, 0.002
CLOCK = {"TimestampLatch": "", "TimestampLatchValue": 0}
"""The features of a camera whose clock can be read."""


class FakeDevice:
    """A camera of a maker's producer. Its attributes set its faults.

    `keeps` holds features that read back with another value. `faults` holds, by the number of a picture,
    ``lost``, ``incomplete`` or ``small``. `switched` lists what was switched on or off, and when.
    `losing` is the number of the next switches whose answers are lost.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.listed = Listed("Maker", "Gen", "S1", "Maker-S1", "left camera", "U3V")
        self.values: dict[str, Any] = {
            "PixelFormat": "Mono8",
            "Width": 640,
            "Height": 480,
            "OffsetX": 8,
            "OffsetY": 8,
            "AcquisitionMode": "SingleFrame",
            "AcquisitionFrameRateEnable": False,
            "AcquisitionFrameRate": 10.0,
            "ExposureAuto": "Continuous",
            "ExposureTime": 1000.0,
            "Gain": 3.0,
            "DeviceFirmwareVersion": "1.7",
        }
        self.selected: dict[str, tuple[str, ...]] = {}
        self.keeps: dict[str, Any] = {}
        self.faults: dict[int, str] = {}
        self.silent = self.gone = self.numberless = False
        self.stamps = True
        self.latch_s = 1e-3
        self.losing = 0
        self.begun_s, self.buffers, self.exposed = 0.0, 0, 0
        self.first_number = 1
        self.filled: list[int] = []
        self.connections = 0
        self.switched: list[tuple[float, str, bool]] = []

    def has(self, feature: str) -> bool:
        self._answer()
        return feature in self.values

    def entries(self, feature: str) -> tuple[str, ...]:
        return self.selected[feature]

    def text(self, feature: str) -> str:
        self._answer()
        return str(self.values[feature])

    def number(self, feature: str) -> float:
        self._answer()
        return float(self.values[feature])

    def set(self, feature: str, value: str | float | bool) -> None:
        self._answer()
        if value == "Refused":
            raise GentlError(f"Feature {feature!r} : cannot convert value 'Refused', the value is invalid.")
        self.values[feature] = self.keeps.get(feature, value)
        if isinstance(value, bool):
            self.switched.append((self.clock.now_s(), feature, self.values[feature]))
            if self.losing:
                self.losing -= 1
                raise GentlError("Operation timed out")

    def execute(self, feature: str) -> None:
        """Latch the camera's clock, which takes its time on the way there and back."""
        assert feature == "TimestampLatch"
        self.clock.sleep(self.latch_s / 2)
        self.values["TimestampLatchValue"] = round(self.camera_s(self.clock.now_s()) * 1e9)
        self.clock.sleep(self.latch_s / 2)

    def camera_s(self, time_s: float) -> float:
        """Return a time on the camera's own clock, which goes wrong by 40 µs per second."""
        return 7.0 + time_s * (1.0 + 40e-6)

    def start(self, buffers: int) -> None:
        self.begun_s, self.buffers, self.exposed, self.filled = self.clock.now_s(), buffers, 0, []

    def pop(self) -> Picture | None:
        if self.gone:
            raise GentlError("Device has been removed")
        self.fill()
        return self.picture(self.filled.pop(0)) if self.filled else None

    def skip(self) -> bool:
        return self.pop() is not None

    def fill(self) -> None:
        """Put the pictures that have arrived by now into free buffers."""
        while not self.silent and self.begun(self.exposed) + EXPOSURE_S + TRANSFER_S <= self.clock.now_s():
            if len(self.filled) < self.buffers and self.faults.get(self.exposed) != "lost":
                self.filled.append(self.exposed)
            self.exposed += 1

    def begun(self, shown: int) -> float:
        """Return when the exposure of a picture began."""
        return self.begun_s + shown * INTERVAL_S

    def picture(self, shown: int) -> Picture:
        fault = self.faults.get(shown, "")
        dtype: Any = np.uint8 if self.values["PixelFormat"] == "Mono8" else np.uint16
        size = (HEIGHT // 2, WIDTH) if fault == "small" else (HEIGHT, WIDTH)
        pixels = np.full(size, shown % 2 ** (8 * np.dtype(dtype).itemsize), dtype)
        stamp_s = self.camera_s(self.begun(shown)) if self.stamps else None
        number = None if self.numberless else (shown + self.first_number - 1) % 65535 + 1
        return Picture(number, stamp_s, pixels, complete=fault != "incomplete")

    def close(self) -> None:
        self.connections -= 1

    def go_on(self) -> None:
        """Film again after silence, without the frames that are missing because of it."""
        if self.silent:
            self.begun_s = self.clock.now_s() - self.exposed * INTERVAL_S
        self.silent = False

    def _answer(self) -> None:
        if self.gone:
            raise GentlError("Device has been removed")


class FakeProducer:
    """A producer that finds the plugged cameras."""

    def __init__(self, *plugged: FakeDevice) -> None:
        self.plugged = list(plugged)
        self.users = 1

    def connect(self, choose: Callable[[Sequence[Listed]], Listed]) -> tuple[Listed, FakeDevice]:
        chosen = choose([device.listed for device in self.plugged if not device.gone])
        device = next(device for device in self.plugged if device.listed is chosen)
        if device.connections:
            raise GentlError("GenTL exception: Requested resource is already in use.")
        device.connections += 1
        return chosen, device

    def release(self) -> None:
        self.users -= 1


def settings(**changes: object) -> GentlSettings:
    values = {
        "camera": "S1",
        "format": "Mono12",
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "rate_hz": 1 / INTERVAL_S,
        "exposure_us": EXPOSURE_S * 1e6,
        "gain": 2.0,
    }
    return GentlSettings.model_validate({k: v for k, v in (values | changes).items() if v is not None})


def opened(source: FakeProducer | FakeDevice, context: OpenContext, **changes: object) -> GentlCamera:
    """Open the driver on a simulated producer, with the settings that all its tests use."""
    producer = FakeProducer(source) if isinstance(source, FakeDevice) else source
    return GentlCamera(settings(**changes), context, [producer])
