"""Connection to one Aravis camera, which gets its settings and then films until `close`."""

import contextlib
import ctypes
import math
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from drivers.cameras.aravis.features import Features
from drivers.cameras.aravis.library import Aravis, AravisError
from drivers.cameras.aravis.settings import AravisSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Frame, Setting

UNSETTLED_FRAMES = 2
CLOCK_SET_S = 0.01
"""If the system's date jumps by more than this time in s against the rig's clock, somebody has set it."""
READINGS = 3
LONGEST_WAIT_S = 3600.0
SHORT_COUNTER = 0xFFFF
"""Largest frame number of GigE Vision 1.x: the camera's frame counter has 16 bits and skips 0."""
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
        self._last_id: int | None = None
        self._number = 0
        self._last_arrived_s = 0.0
        self._unsettled = UNSETTLED_FRAMES
        self._date_s = self._date_less_clock_s()
        self.seen = 0
        self._camera: int | None = library.call("camera_new", settings.camera.encode())
        try:
            self._require_control()
            self.vendor = library.text("camera_get_vendor_name", self._camera)
            self.model = library.text("camera_get_model_name", self._camera)
            self.serial = library.text("camera_get_device_serial_number", self._camera)
            self._features = Features(library, self._camera, device)
            self._features.write(settings)
            self._exposure_us = self._features.numbers["exposure_time"]
            self._gain = self._features.numbers.get("gain", math.nan)
            # if the delay is not known, assume one frame time, so that the age of a frame is never
            # underestimated
            transfer_us = 1e6 / settings.rate_hz if settings.transfer_us is None else settings.transfer_us
            self._behind_s = (self._exposure_us + transfer_us) * 1e-6
            self._begin()
        except BaseException:
            self.close()
            raise

    @property
    def interval_s(self) -> float:
        """Time between two frames, in seconds."""
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
        self._features.verify()

    def read_settings(self) -> dict[str, Setting]:
        """Read all settings back from the camera. Raise `LinkLost` if the camera does not answer."""
        return self._features.read(self._settings)

    def close(self) -> None:
        """Stop filming and release all resources. A repeated call has no effect."""
        camera, self._camera = self._camera, None
        stream, self._stream = self._stream, None
        if stream is not None:
            with contextlib.suppress(AravisError):  # ignore the error of a disconnected camera
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

    def _number_of(self, buffer: int, arrived_s: float) -> int:
        """Return a frame number that also increases when the camera's 16-bit counter starts again.

        If the camera's counter repeats or decreases, the frame number also repeats or decreases. The number
        of overflows is computed from the time between two frames.
        """
        id = int(self._library.call("buffer_get_frame_id", buffer))
        if self._last_id is None:
            self._number = id
        else:
            step = id - self._last_id
            if max(id, self._last_id) <= SHORT_COUNTER:
                by_time = (arrived_s - self._last_arrived_s) / self.interval_s
                step += SHORT_COUNTER * round((by_time - step) / SHORT_COUNTER)
            self._number += step
        self._last_id, self._last_arrived_s = id, arrived_s
        return self._number

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
        sequence = self._number_of(buffer, arrived_s)
        exposed_s = arrived_s - self._behind_s
        if self._unsettled:
            self._unsettled -= 1
            return None
        if exposed_s < after_s:
            return None
        status = int(call("buffer_get_status", buffer))
        image, flags = self._image(buffer, whole=status == 0)
        return Frame(
            image=image,
            exposed_s=exposed_s,
            received_s=received_s,
            utc=datetime.fromtimestamp(exposed_s + date_s, UTC),
            sequence=sequence,
            flags=flags | (status if status >= 0 else UNKNOWN_STATUS),
            exposure_us=self._exposure_us,
            gain=self._gain,
        )

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
