"""Connection to one GenTL camera, which gets its settings and then films until `close`."""

import math
from datetime import datetime, timedelta
from typing import Any

from numpy.typing import NDArray

from drivers.cameras.genicam.session import OTHER_SIZE, FilmingDevice
from drivers.cameras.genicam.stamps import Times
from drivers.cameras.gentl.device import Device, GentlError, Picture
from drivers.cameras.gentl.features import Features
from drivers.cameras.gentl.settings import GentlSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import Frame

POLL_S = 1e-3
"""Time, in seconds, between two looks for a frame. Nothing else tells when a frame has arrived."""
APART = 0.5
"""Frames are at least this part of a frame time apart."""
INCOMPLETE = 1
"""Flag of a frame that the producer calls incomplete."""
REPEATED = 1 << 1
"""Flag of a frame whose number is not higher than the one before: an old picture that came again."""


class GentlSession(FilmingDevice[Features]):
    """An opened camera that films; its settings were written and read back.

    `device` is the connected camera, which `close` closes, and so does a failed configuration. Raise
    `DeviceError` if the camera does not accept a setting.
    """

    def __init__(self, device: Device, settings: GentlSettings, name: str, clock: Clock) -> None:
        super().__init__(settings, name, clock)
        self._device = device
        self._name = name
        self._count = 0
        self._last: int | None = None
        self._earliest_s = -math.inf
        self._features = Features(device, settings, name, clock, self._talk)
        try:
            self._features.write()
            self._begin_times(self._features.exposure_us)
            self._absent_s = clock.now_s()
            device.start(settings.buffers)
        except GentlError as error:
            self.close()
            remedy = "check cable and power, and that no other program uses the camera"
            raise DeviceFault(name, "start", "a filming camera", str(error), remedy) from error
        except BaseException:
            self.close()
            raise

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

    def close(self) -> None:
        """Stop filming and release all resources. A repeated call has no effect."""
        self._features.lines.close()
        self._device.close()

    def _frame(self, picture: Picture, after_s: float) -> Frame | None:
        self.seen += 1
        received_s = self._clock.now_s()
        sequence = self._numbers.number(self._number_of(picture), received_s)
        repeated = self._last is not None and sequence <= self._last
        self._last = sequence
        times = self._times(picture, received_s)
        if not self._is_wanted(times, after_s):
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
            exposure_us=self._features.exposure_us,
            gain=self._features.gain,
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
        if self._camera_clock is None:
            apart_s = APART * self.shortest_s
            self._earliest_s = min(max(self._absent_s, self._earliest_s + apart_s), received_s)
            return self._rule.of_arrival(received_s, self._earliest_s)
        if picture.stamp_s is None:
            raise DeviceFault(
                self._name,
                "get frame",
                "a time stamp of the camera",
                "none",
                'leave out `stamp`, or use "arrival"',
            )
        return self._times_of(picture.stamp_s, received_s)

    def _image(self, picture: Picture) -> tuple[NDArray[Any], int]:
        black, pixels = self._black(), picture.pixels
        if pixels is None or pixels.shape != black.shape or pixels.dtype != black.dtype:
            return black, OTHER_SIZE
        if picture.complete:
            self._require_levels(pixels)
        return pixels, 0

    def _utc_before(self, age_s: float) -> datetime:
        return self._clock.utc() - timedelta(seconds=age_s)
