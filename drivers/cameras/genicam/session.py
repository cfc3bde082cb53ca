"""What the sessions of GenICam cameras share, whichever library delivers their frames."""

import math
import threading
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.genicam.camera_clock import LatchedClock
from drivers.cameras.genicam.features import GenicamFeatures
from drivers.cameras.genicam.numbers import FrameNumbers
from drivers.cameras.genicam.settings import GenicamSettings
from drivers.cameras.genicam.stamps import StampRule, Times, require_past
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Setting

UNSETTLED_FRAMES = 2
OTHER_SIZE = 1 << 8
"""Flag of a frame that is no grey-level picture of the size in the settings."""
_BYTE_BITS = 8

F = TypeVar("F", bound=GenicamFeatures)


class FilmingDevice(Generic[F]):
    """An opened camera that films; its settings were written and read back.

    A driver sets `_features`, and then calls `_begin_times`.
    """

    _features: F

    def __init__(self, settings: GenicamSettings, device: str, clock: Clock) -> None:
        self._given = settings
        self._device_name = device
        self._clock = clock
        # Only one thread at a time may talk with the camera: a pulse may come during a stream.
        self._talk = threading.Lock()
        self._numbers = FrameNumbers(self.interval_s)
        self._camera_clock: LatchedClock | None = None
        # a triggered frame is exposed after the settings were written
        self._unsettled = 0 if settings.trigger else UNSETTLED_FRAMES
        self.seen = 0

    @property
    def interval_s(self) -> float:
        """Time between two frames, in seconds; infinite if a trigger begins each frame."""
        return math.inf if self._given.trigger else self.shortest_s

    @property
    def shortest_s(self) -> float:
        """Shortest time between two frames, in seconds, also if a trigger begins each frame."""
        return 1 / self._given.rate_hz

    def verify(self) -> None:
        """Read frame rate, exposure time and gain back. Raise `DeviceFault` if a value has changed.

        If the camera does not answer, `LinkLost` is raised.
        """
        with self._talk:
            self._features.verify()

    def read_settings(self) -> dict[str, Setting]:
        """Read all settings back from the camera. Raise `LinkLost` if the camera does not answer."""
        with self._talk:
            return self._features.read()

    def pulse(self) -> None:
        """Begin a pulse on the output line. Raise `DeviceError` if it may not have been given."""
        self._features.lines.pulse()

    def _begin_times(self, exposure_us: float) -> None:
        """Prepare the times of frames, with the exposure time as read back, NaN if it is unknown."""
        self._rule = StampRule(self._given, exposure_us)
        if self._given.stamp != "arrival":
            self._camera_clock = LatchedClock(self._features, self._device_name, self._clock)

    def _times_of(self, stamp_s: float, received_s: float) -> Times:
        """Return the times of a frame from the camera's own stamp. The camera's clock must be read."""
        clock = self._camera_clock
        assert clock is not None
        with self._talk:
            clock.keep()
        times = self._rule.of_camera(*clock.camera.on_rig(stamp_s))
        return require_past(times, received_s, self._device_name)

    def _is_wanted(self, times: Times, after_s: float) -> bool:
        """Return whether a frame was exposed with these settings, and after a time."""
        if self._unsettled:
            self._unsettled -= 1
            return False
        return times.exposed_s >= after_s

    def _black(self) -> NDArray[Any]:
        """Return a black picture of the size and the type of the settings."""
        container: Any = np.uint8 if self._given.bits <= _BYTE_BITS else np.uint16
        return np.zeros((self._given.height_px, self._given.width_px), container)

    def _require_levels(self, image: NDArray[Any]) -> None:
        """Raise `DeviceFault` if a whole picture has grey levels that its format does not have."""
        highest = int(image.max())
        if highest >> self._given.bits:
            raise DeviceFault(
                self._device_name,
                "get frame",
                f"grey levels of {self._given.bits} bits",
                str(highest),
                "choose format Mono16: the camera uses more bits than the format says",
            )
