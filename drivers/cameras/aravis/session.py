"""Connection to one Aravis camera, which gets its settings and then films until `close`."""

import contextlib
import ctypes
import math
from datetime import UTC, datetime
from typing import Any

from drivers.cameras.aravis.features import Features
from drivers.cameras.aravis.library import Aravis, AravisError
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.genicam.session import OTHER_SIZE, FilmingDevice
from drivers.cameras.genicam.stamps import Times
from drivers.clock import Clock
from drivers.interfaces import Frame

CLOCK_SET_S = 0.01
"""If the system's date jumps by more than this time in s against the rig's clock, somebody has set it."""
READINGS = 3
LONGEST_WAIT_S = 3600.0
UNKNOWN_STATUS = 0xFF


class AravisSession(FilmingDevice[Features]):
    """An opened camera that films; its settings were written and read back.

    Raise `AravisError` if the camera cannot be opened, and `DeviceFault` if the camera does not accept a
    setting.
    """

    def __init__(self, library: Aravis, settings: AravisSettings, device: str, clock: Clock) -> None:
        super().__init__(settings, device, clock)
        self._library = library
        self._settings = settings
        self._stream: int | None = None
        self._date_s = self._date_less_clock_s()
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
            self._begin_times(self._exposure_us)
            self._begin()
        except BaseException:
            self.close()
            raise

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
        if not self._is_wanted(times, after_s):
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
        if self._camera_clock is None:
            return self._rule.of_arrival(arrived_s, arrived_s)
        return self._times_of(1e-9 * int(self._library.call("buffer_get_timestamp", buffer)), received_s)

    def _image(self, buffer: int, *, whole: bool) -> tuple[Any, int]:
        width, height = self._settings.width_px, self._settings.height_px
        call, size = self._library.call, ctypes.c_size_t()
        data = call("buffer_get_data", buffer, ctypes.byref(size))
        image = self._black()
        if not data or size.value < image.nbytes:
            return image, OTHER_SIZE
        # compare whole frames only: without its first packet a frame has no size
        if whole and (width, height) != (
            call("buffer_get_image_width", buffer),
            call("buffer_get_image_height", buffer),
        ):
            return image, OTHER_SIZE
        ctypes.memmove(image.ctypes.data, data, image.nbytes)
        if whole:
            self._require_levels(image)
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
