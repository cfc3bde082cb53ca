"""Connection to one Aravis camera, which gets its settings and then films until `close`."""

import contextlib
import ctypes
import math
import threading
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from drivers.cameras.aravis.features import Features
from drivers.cameras.aravis.library import Aravis, AravisError
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.genicam.camera_clock import LatchedClock
from drivers.cameras.genicam.numbers import FrameNumbers
from drivers.cameras.genicam.stamps import StampRule, Times, require_past
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Frame, Setting

UNSETTLED_FRAMES = 2
CLOCK_SET_S = 0.01
"""If the system's date jumps by more than this time in s against the rig's clock, somebody has set it."""
READINGS = 3
LONGEST_WAIT_S = 3600.0
UNKNOWN_STATUS = 0xFF
OTHER_SIZE = 1 << 8
"""Flag of a frame whose size in pixels or bytes differs from the settings."""


class AravisSession:
    """An opened camera that films; its settings were written and read back.

    Raise `AravisError` if the camera cannot be opened, and `DeviceFault` if the camera does not accept a
    setting.
    """

    def __init__(self, library: Aravis, settings: AravisSettings, device: str, clock: Clock) -> None:
        self._library = library
        self._settings = settings
        self._device = device
        self._fault = partial(DeviceFault, self._device)
        self._clock = clock
        self._stream: int | None = None
        # Only one thread at a time may talk with the camera: a pulse may come during a stream.
        self._talk = threading.Lock()
        self._numbers = FrameNumbers(self.interval_s)
        self._camera_clock: LatchedClock | None = None
        # a triggered frame is exposed after the settings were written
        self._unsettled = 0 if settings.trigger else UNSETTLED_FRAMES
        self._date_s = self._date_less_clock_s()
        self.seen = 0
        self._camera: int | None = library.call("camera_new", settings.camera.encode())
        try:
            self._require_control()
            self.vendor = library.text("camera_get_vendor_name", self._camera)
            self.model = library.text("camera_get_model_name", self._camera)
            self.serial = library.text("camera_get_device_serial_number", self._camera)
            self._features = Features(library, self._camera, settings, device, clock, self._talk)
            self._features.write()
            self._exposure_us = self._features.numbers["exposure_time"]
            self._gain = self._features.numbers.get("gain", math.nan)
            self._rule = StampRule(settings, self._exposure_us)
            if settings.stamp != "arrival":
                self._camera_clock = LatchedClock(self._features, device, clock)
            self._begin()
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
        """Return the next frame exposed after `after_s`, even if damaged. Return None after `timeout_s`."""
        deadline_s = self._clock.now_s() + timeout_s
        while (left_s := deadline_s - self._clock.now_s()) > 0:
            wait_us = int(min(left_s, LONGEST_WAIT_S) * 1e6)
            buffer = self._library.call("stream_timeout_pop_buffer", self._stream, wait_us)
            if not buffer:
                continue
            try:
                frame = self._frame(buffer, after_s)
            finally:
                self._library.call("stream_push_buffer", self._stream, buffer)
            if frame is not None:
                return frame
        return None

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

    def close(self) -> None:
        """Stop filming and release all resources. A repeated call has no effect."""
        camera, self._camera = self._camera, None
        stream, self._stream = self._stream, None
        if stream is not None:
            self._features.lines.close()
            # ignore the errors of a disconnected camera
            with contextlib.suppress(AravisError):
                self._library.call("camera_stop_acquisition", camera)
        self._library.release(stream)
        self._library.release(camera)

    def _require_control(self) -> None:
        """Check that this program controls the camera, because Aravis would retry a refused write for
        seconds."""
        call, camera = self._library.call, self._camera
        if not camera:
            raise AravisError("none")
        if call("camera_is_gv_device", camera):
            device = call("camera_get_device", camera)
            if not call("gv_device_is_controller", device):
                raise AravisError("one that another program controls")

    def _begin(self) -> None:
        call, attempt = self._library.call, self._features.attempt
        payload = attempt("read payload", "camera_get_payload")
        self._stream = attempt("open stream", "camera_create_stream", None, None)
        for _ in range(self._settings.buffers):
            call("stream_push_buffer", self._stream, call("buffer_new_allocate", payload))
        attempt("start", "camera_start_acquisition")

    def _frame(self, buffer: int, after_s: float) -> Frame | None:
        call = self._library.call
        self.seen += 1
        received_s, date_s = self._clock.now_s(), self._date_less_clock_s()
        if abs(date_s - self._date_s) > CLOCK_SET_S:
            # Frames that arrived before this change have timestamps with the old date, so count how many may
            # remain.
            self._unsettled = self._settings.buffers
        self._date_s = date_s
        # Aravis' timestamp is the date and time at which the first packet arrived
        arrived_s = call("buffer_get_system_timestamp", buffer) * 1e-9 - date_s
        sequence = self._numbers.number(int(call("buffer_get_frame_id", buffer)), arrived_s)
        times = self._times(buffer, arrived_s, received_s)
        if self._unsettled:
            self._unsettled -= 1
            return None
        if times.exposed_s < after_s:
            return None
        status = int(call("buffer_get_status", buffer))
        image, flags = self._image(buffer, whole=status == 0)
        return Frame(
            image=image,
            exposed_s=times.exposed_s,
            received_s=received_s,
            utc=datetime.fromtimestamp(times.exposed_s + date_s, UTC),
            sequence=sequence,
            flags=flags | (status if status >= 0 else UNKNOWN_STATUS),
            exposure_us=self._exposure_us,
            gain=self._gain,
            middle_s=times.middle_s,
            middle_std_s=times.middle_std_s,
        )

    def _times(self, buffer: int, arrived_s: float, received_s: float) -> Times:
        """Return when the frame in a buffer was exposed."""
        clock = self._camera_clock
        if clock is None:
            return self._rule.of_arrival(arrived_s, arrived_s)
        with self._talk:
            clock.keep()
        stamp_ns = int(self._library.call("buffer_get_timestamp", buffer))
        stamped_s, half_s = clock.camera.on_rig(stamp_ns * 1e-9)
        return require_past(self._rule.of_camera(stamped_s, half_s), received_s, self._device)

    def _image(self, buffer: int, *, whole: bool) -> tuple[Any, int]:
        width, height = self._settings.width_px, self._settings.height_px
        call, size = self._library.call, ctypes.c_size_t()
        data = call("buffer_get_data", buffer, ctypes.byref(size))
        container: Any = np.uint8 if self._settings.bits <= 8 else np.uint16
        image = np.zeros((height, width), container)
        if not data or size.value < image.nbytes:
            return image, OTHER_SIZE
        # compare whole frames only: without its first packet a frame has no size
        if whole and (width, height) != (
            call("buffer_get_image_width", buffer),
            call("buffer_get_image_height", buffer),
        ):
            return image, OTHER_SIZE
        ctypes.memmove(image.ctypes.data, data, image.nbytes)
        highest = int(image.max())
        if whole and highest >> self._settings.bits:
            raise self._fault(
                "get frame",
                f"grey levels of {self._settings.bits} bits",
                str(highest),
                "choose format Mono16: the camera uses more bits than the format says",
            )
        return image, 0

    def _date_less_clock_s(self) -> float:
        """Return the system's date minus the rig's clock, in seconds.

        The date and the clock are read one after the other, several times. The pair that was read most
        quickly is used.
        """
        readings = []
        for _ in range(READINGS):
            before_s = self._clock.now_s()
            date_s = self._clock.utc().timestamp()
            after_s = self._clock.now_s()
            readings.append((after_s - before_s, date_s - (before_s + after_s) / 2))
        return min(readings)[1]
