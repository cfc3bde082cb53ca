"""Connection to one GenTL camera, which gets its settings and then films until `close`."""

import math
import threading
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.genicam.camera_clock import LatchedClock
from drivers.cameras.genicam.numbers import FrameNumbers
from drivers.cameras.genicam.stamps import StampRule, Times, require_past
from drivers.cameras.gentl.device import Device, GentlError, Picture
from drivers.cameras.gentl.features import Features
from drivers.cameras.gentl.settings import GentlSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import Frame, Setting

UNSETTLED_FRAMES = 2
POLL_S = 1e-3
"""Time, in seconds, between two looks for a frame. Nothing else tells when a frame has arrived."""
APART = 0.5
"""Frames are at least this part of a frame time apart."""
BYTE_BITS = 8
INCOMPLETE = 1
"""Flag of a frame that the producer calls incomplete."""
REPEATED = 1 << 1
"""Flag of a frame whose number is not higher than the one before: an old picture that came again."""
OTHER_SIZE = 1 << 8
"""Flag of a frame without a grey-level picture of the size in the settings."""


class GentlSession:
    """An opened camera that films; its settings were written and read back.

    `device` is the connected camera, which `close` closes, and so does a failed configuration. Raise
    `DeviceError` if the camera does not accept a setting.
    """

    def __init__(self, device: Device, settings: GentlSettings, name: str, clock: Clock) -> None:
        self._device = device
        self._settings = settings
        self._name = name
        self._fault = partial(DeviceFault, name, "get frame")
        self._clock = clock
        # Only one thread at a time may talk with the camera: a pulse may come during a stream.
        self._talk = threading.Lock()
        self._numbers = FrameNumbers(self.interval_s)
        self._camera_clock: LatchedClock | None = None
        self._count = 0
        self._last: int | None = None
        # a triggered frame is exposed after the settings were written
        self._unsettled = 0 if settings.trigger else UNSETTLED_FRAMES
        self._earliest_s = -math.inf
        self.seen = 0
        self._features: Features | None = None
        try:
            self._features = features = Features(device, settings, name, clock, self._talk)
            features.write()
            self._rule = StampRule(settings, features.exposure_us)
            if settings.stamp != "arrival":
                self._camera_clock = LatchedClock(features, name, clock)
            self._absent_s = clock.now_s()
            device.start(settings.buffers)
        except GentlError as error:
            self.close()
            remedy = "check cable and power, and that no other program uses the camera"
            raise DeviceFault(name, "start", "a filming camera", str(error), remedy) from error
        except BaseException:
            self.close()
            raise

    @property
    def interval_s(self) -> float:
        """Time between two frames, in seconds; infinite if a trigger begins each frame."""
        return math.inf if self._settings.trigger else self.shortest_s

    @property
    def shortest_s(self) -> float:
        """Shortest time between two frames, in seconds, also if a trigger begins each frame."""
        return 1 / self._settings.rate_hz

    def next_frame(self, timeout_s: float, after_s: float) -> Frame | None:
        """Return the next frame exposed after `after_s`, even if damaged. Return None after `timeout_s`.

        Raise `LinkLost` if the producer reports an error.
        """
        deadline_s = self._clock.now_s() + timeout_s
        try:
            if self._absent_s < after_s:
                self._skip_waiting()
            while True:
                now_s = self._clock.now_s()
                picture = self._device.pop()
                if picture is None:
                    self._absent_s = now_s
                elif (frame := self._frame(picture, after_s)) is not None:
                    return frame
                left_s = deadline_s - self._clock.now_s()
                if not left_s > 0:
                    return None
                if picture is None:
                    self._clock.sleep(min(left_s, POLL_S))
        except GentlError as error:
            remedy = "check cable and power of the camera"
            raise LinkLost(self._name, "get frame", "a frame", str(error), remedy) from error

    def _skip_waiting(self) -> None:
        """Throw all frames away that have arrived: nothing tells how long they have been waiting."""
        while True:
            now_s = self._clock.now_s()
            if not self._device.skip():
                self._absent_s = now_s
                return
            self.seen += 1

    def verify(self) -> None:
        """Read frame rate, exposure time and gain back. Raise `DeviceFault` if a value has changed.

        If the camera does not answer, `LinkLost` is raised.
        """
        with self._talk:
            self._known.verify()

    def read_settings(self) -> dict[str, Setting]:
        """Read all settings back from the camera. Raise `LinkLost` if the camera does not answer."""
        with self._talk:
            return self._known.read()

    def pulse(self) -> None:
        """Begin a pulse on the output line. Raise `DeviceError` if it may not have been given."""
        self._known.lines.pulse()

    def close(self) -> None:
        """Stop filming and release all resources. A repeated call has no effect."""
        if self._features is not None:
            self._features.lines.close()
        self._device.close()

    @property
    def _known(self) -> Features:
        assert self._features is not None
        return self._features

    def _frame(self, picture: Picture, after_s: float) -> Frame | None:
        self.seen += 1
        received_s = self._clock.now_s()
        sequence = self._numbers.number(self._number_of(picture), received_s)
        repeated = self._last is not None and sequence <= self._last
        self._last = sequence
        times = self._times(picture, received_s)
        if self._unsettled:
            self._unsettled -= 1
            return None
        if times.exposed_s < after_s:
            return None
        image, other = self._image(picture)
        age_s = self._clock.now_s() - times.exposed_s
        return Frame(
            image=image,
            exposed_s=times.exposed_s,
            received_s=received_s,
            utc=self._utc_before(age_s),
            sequence=sequence,
            flags=other | INCOMPLETE * (not picture.complete) | REPEATED * repeated,
            exposure_us=self._known.exposure_us,
            gain=self._known.gain,
            middle_s=times.middle_s,
            middle_std_s=times.middle_std_s,
        )

    def _number_of(self, picture: Picture) -> int:
        """Return the camera's number of a frame, or its number in the order of arrival."""
        self._count += 1
        return self._count if picture.number is None else picture.number

    def _times(self, picture: Picture, received_s: float) -> Times:
        """Return when a frame was exposed.

        A frame has arrived after the last look that found none. If several frames had arrived, each did so at
        least half a frame time after the one before.
        """
        clock = self._camera_clock
        if clock is None:
            apart_s = APART / self._settings.rate_hz
            self._earliest_s = min(max(self._absent_s, self._earliest_s + apart_s), received_s)
            return self._rule.of_arrival(received_s, self._earliest_s)
        if picture.stamp_s is None:
            raise self._fault("a time stamp of the camera", "none", 'leave out `stamp`, or use "arrival"')
        with self._talk:
            clock.keep()
        times = self._rule.of_camera(*clock.camera.on_rig(picture.stamp_s))
        return require_past(times, received_s, self._name)

    def _image(self, picture: Picture) -> tuple[NDArray[np.uint8] | NDArray[np.uint16], int]:
        settings = self._settings
        container: Any = np.uint8 if settings.bits <= BYTE_BITS else np.uint16
        shape = settings.height_px, settings.width_px
        pixels = picture.pixels
        if pixels is None or pixels.shape != shape or pixels.dtype != container:
            return np.zeros(shape, container), OTHER_SIZE
        highest = int(pixels.max())
        if picture.complete and highest >> settings.bits:
            raise self._fault(
                f"grey levels of {settings.bits} bits",
                str(highest),
                "choose format Mono16: the camera uses more bits than the format says",
            )
        return pixels, 0

    def _utc_before(self, age_s: float) -> datetime:
        return self._clock.utc() - timedelta(seconds=age_s)
