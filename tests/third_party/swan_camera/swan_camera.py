"""A camera driver by a third party, in a separate package with one module.

The camera has no sensor. Its images show a random pattern of Gaussian speckles and white noise.
"""

import threading

import numpy as np
from pydantic import Field
from scipy.ndimage import gaussian_filter

from drivers.errors import DeviceFault, DeviceTimeout
from drivers.interfaces import CameraInfo, Frame, OpenContext
from drivers.registry import DriverSpec, Finder, Found
from drivers.settings import Settings

SERIALS = ("S-0042",)
"""The cameras that are plugged in, as the maker's library would list them."""
WIDTH_PX, HEIGHT_PX, BITS = 160, 120, 8


class SwanSettings(Settings):
    """Rig-file settings of the camera."""

    serial: str
    exposure_us: float = Field(default=5000.0, gt=0, le=1e6)


class SwanCamera:
    """A `Camera`."""

    def __init__(self, settings: SwanSettings, context: OpenContext) -> None:
        self._name = f"{context.name} ({settings.serial})"
        if settings.serial not in SERIALS:
            raise self._fault(
                "open camera", f"one of {', '.join(SERIALS)}", settings.serial, "correct serial"
            )
        self.info = CameraInfo(
            "Swan", "Cygnet", settings.serial, width_px=WIDTH_PX, height_px=HEIGHT_PX, bits=BITS
        )
        self._clock = context.clock
        self._exposure_us = settings.exposure_us
        self._lock = threading.Lock()
        self._closed = False
        self._frames = 0
        self._noise = np.random.default_rng(1)
        pattern = gaussian_filter(self._noise.normal(size=(HEIGHT_PX, WIDTH_PX)), 1.5)
        self._pattern = 120.0 + 35.0 * pattern / pattern.std()

    def grab(self, timeout_s: float) -> Frame:
        """Expose a frame. Raise `DeviceTimeout` if the exposure is longer than `timeout_s`."""
        with self._lock:
            if self._closed:
                raise self._fault("grab", "an open camera", "a closed one", "open it again")
            if not self._exposure_us * 1e-6 <= timeout_s:
                self._clock.sleep(timeout_s if timeout_s > 0 else 0.0)
                raise DeviceTimeout(
                    self._name, "grab", f"a frame within {timeout_s:g} s", "none", "allow more time"
                )
            exposed_s, utc = self._clock.now_s(), self._clock.utc()
            self._clock.sleep(self._exposure_us * 1e-6)
            self._frames += 1
            grey = self._pattern + self._noise.normal(size=self._pattern.shape)
            return Frame(
                image=np.clip(grey, 0, 255).astype(np.uint8),
                exposed_s=exposed_s,
                received_s=self._clock.now_s(),
                utc=utc,
                sequence=self._frames,
                flags=0,
                exposure_us=self._exposure_us,
                gain=1.0,
            )

    def close(self) -> None:
        """Refuse every later call. A repeated call has no effect."""
        self._closed = True

    def _fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        return DeviceFault(self._name, step, expected, got, remedy)


def cameras() -> list[Found]:
    """Return the cameras that are plugged in."""
    return [Found(f"Swan Cygnet, serial number {serial}", {"serial": serial}) for serial in SERIALS]


SPEC = DriverSpec("camera", SwanSettings, SwanCamera, find=Finder("Swan cameras", listed=cameras))
