"""One GigE Vision camera from opening to closing: set up with everything read back, filming."""

import contextlib
import ctypes
import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import numpy as np

from drivers.aravis_library import Aravis, AravisError
from drivers.aravis_settings import AravisSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Frame

AUTOMATICS = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto")
CONTINUOUS = 0
TOLERANCE = 1e-3
UNSETTLED_FRAMES = 2
SHORT_COUNTER = 0xFFFF
"""The frame counter of GigE Vision 1.x: 16 bits, and 0 is left out."""
UNKNOWN_STATUS = 0xFF
OTHER_SIZE = 1 << 8
"""Flag of a frame of another size than was set."""


class Session:
    """A camera that films with settings that were read back.

    Parameters
    ----------
    library : Aravis
    settings : AravisSettings
    device : str
        For messages.
    clock : Clock

    Raises
    ------
    AravisError
        If the camera cannot be opened.
    DeviceFault
        If a setting is not taken.
    """

    def __init__(self, library: Aravis, settings: AravisSettings, device: str, clock: Clock) -> None:
        self._library = library
        self._settings = settings
        self._device = device
        self._clock = clock
        self._stream: int | None = None
        self._last_id: int | None = None
        self._number = 0
        self._unsettled = UNSETTLED_FRAMES
        self._camera: int | None = library.call("camera_new", settings.camera.encode())
        try:
            self.vendor = library.text("camera_get_vendor_name", self._camera)
            self.model = library.text("camera_get_model_name", self._camera)
            self.serial = library.text("camera_get_device_serial_number", self._camera)
            self._configure()
            self._begin()
        except BaseException:
            self.close()
            raise

    def drain(self) -> None:
        """Give all waiting buffers back."""
        for _ in range(self._settings.buffers):
            buffer = self._library.call("stream_try_pop_buffer", self._stream)
            if not buffer:
                return
            self._number_of(buffer)
            self._library.call("stream_push_buffer", self._stream, buffer)

    def next_frame(self, timeout_s: float, after_s: float = -math.inf) -> Frame | None:
        """Return the next frame exposed after `after_s`, with its flags; None when the time is over."""
        deadline_s = self._clock.now_s() + timeout_s
        while (left_s := deadline_s - self._clock.now_s()) > 0:
            buffer = self._library.call("stream_timeout_pop_buffer", self._stream, int(left_s * 1e6))
            if not buffer:
                return None
            try:
                frame = self._frame(buffer, after_s)
            finally:
                self._library.call("stream_push_buffer", self._stream, buffer)
            if frame is not None:
                return frame
        return None

    def verify(self) -> None:
        """Read exposure and gain back.

        Raises
        ------
        DeviceFault
            If they have changed.
        AravisError
            If the camera does not answer.
        """
        for name, wanted in (("exposure_time", self._exposure_us), ("gain", self._gain)):
            if math.isnan(wanted):
                continue
            got = float(self._library.call(f"camera_get_{name}", self._camera))
            if abs(got - wanted) > TOLERANCE * abs(wanted):
                raise self._fault(f"verify {name}", f"{wanted:g}", f"{got:g}", "open the camera again")

    def close(self) -> None:
        """Stop filming and release everything; harmless when repeated."""
        camera, self._camera = self._camera, None
        stream, self._stream = self._stream, None
        if stream is not None:
            with contextlib.suppress(AravisError):  # it may be gone already
                self._library.call("camera_stop_acquisition", camera)
        self._library.release(stream)
        self._library.release(camera)

    def _configure(self) -> None:
        settings, call = self._settings, self._library.call
        for name in AUTOMATICS:
            if name not in settings.features and self._has(name):
                self._set_text(name, "Off")
        for name, value in settings.features.items():
            if not self._has(name):
                raise self._fault(f"set {name}", "a feature of the camera", repr(name), "correct `features`")
            self._set_text(name, value)
        self._try(
            "set format",
            lambda: call("camera_set_pixel_format_from_string", self._camera, settings.format.encode()),
        )
        self._require(
            "set format",
            settings.format,
            self._library.text("camera_get_pixel_format_as_string", self._camera),
        )
        self._set_region()
        self._try("set trigger", lambda: call("camera_clear_triggers", self._camera))
        self._try("set mode", lambda: call("camera_set_acquisition_mode", self._camera, CONTINUOUS))
        self._set_number("frame_rate", settings.rate_hz)
        self._exposure_us = self._set_number("exposure_time", settings.exposure_us)
        transfer_us = 1e6 / settings.rate_hz if settings.transfer_us is None else settings.transfer_us
        # a frame is never called younger than it is: what is not known counts as a whole frame time
        self._behind_s = (self._exposure_us + transfer_us) * 1e-6
        self._gain = math.nan
        if settings.gain is not None:
            self._gain = self._set_number("gain", settings.gain)
        elif self._has("Gain") or self._has("GainRaw"):
            self._gain = float(self._try("read gain", lambda: call("camera_get_gain", self._camera)))

    def _begin(self) -> None:
        call = self._library.call
        payload = self._try("read payload", lambda: call("camera_get_payload", self._camera))
        self._stream = self._try(
            "open stream", lambda: call("camera_create_stream", self._camera, None, None)
        )
        for _ in range(self._settings.buffers):
            call("stream_push_buffer", self._stream, call("buffer_new_allocate", payload))
        self._try("start", lambda: call("camera_start_acquisition", self._camera))

    def _set_region(self) -> None:
        settings = self._settings
        wanted = (settings.offset_x_px, settings.offset_y_px, settings.width_px, settings.height_px)
        self._try("set size", lambda: self._library.call("camera_set_region", self._camera, *wanted))
        got = [ctypes.c_int() for _ in wanted]
        self._library.call("camera_get_region", self._camera, *(ctypes.byref(value) for value in got))
        names = "{2} x {3} px at ({0}, {1})"
        self._require("set size", names.format(*wanted), names.format(*(value.value for value in got)))

    def _set_number(self, name: str, wanted: float) -> float:
        step = f"set {name}"
        self._try(step, lambda: self._library.call(f"camera_set_{name}", self._camera, wanted))
        got = float(self._try(step, lambda: self._library.call(f"camera_get_{name}", self._camera)))
        if not abs(got - wanted) <= TOLERANCE * max(abs(wanted), TOLERANCE):
            raise self._fault(step, f"{wanted:g}", f"{got:g} on reading back", "choose what the camera takes")
        return got

    def _set_text(self, name: str, wanted: str) -> None:
        feature = name.encode()
        self._try(
            f"set {name}",
            lambda: self._library.call("camera_set_string", self._camera, feature, wanted.encode()),
        )
        self._require(f"set {name}", wanted, self._library.text("camera_get_string", self._camera, feature))

    def _has(self, feature: str) -> bool:
        return bool(self._library.call("camera_is_feature_available", self._camera, feature.encode()))

    def _require(self, step: str, wanted: str, got: str) -> None:
        if got != wanted:
            raise self._fault(step, wanted, f"{got} on reading back", "choose what the camera takes")

    def _try(self, step: str, act: Callable[[], Any]) -> Any:
        try:
            return act()
        except AravisError as error:
            raise self._fault(
                step, "acceptance", str(error), "choose what the camera takes, or check its cable"
            ) from error

    def _number_of(self, buffer: int) -> int:
        """Continue the camera's counter beyond its 16 bits; one that stands still or goes back stays so."""
        id = int(self._library.call("buffer_get_frame_id", buffer))
        if self._last_id is None:
            self._number = id
        else:
            step = id - self._last_id
            if max(id, self._last_id) <= SHORT_COUNTER:
                half = SHORT_COUNTER // 2
                step = (step + half) % SHORT_COUNTER - half
            self._number += step
        self._last_id = id
        return self._number

    def _frame(self, buffer: int, after_s: float) -> Frame | None:
        call = self._library.call
        sequence = self._number_of(buffer)
        received_s, utc = self._clock.now_s(), self._clock.utc()
        # Aravis stamps the first packet's arrival with the date
        arrived = datetime.fromtimestamp(call("buffer_get_system_timestamp", buffer) * 1e-9, UTC)
        age_s = (utc - arrived).total_seconds()
        exposed_s = received_s - age_s - self._behind_s
        if self._unsettled:
            self._unsettled -= 1
            return None
        if exposed_s < after_s:
            return None
        status = int(call("buffer_get_status", buffer))
        image, flags = self._image(buffer, whole=status == 0)
        return Frame(
            image=image,
            exposed_s=min(exposed_s, received_s),
            received_s=received_s,
            utc=datetime.fromtimestamp(utc.timestamp() - (received_s - exposed_s), UTC),
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
        # a frame whose first packet is missing has no size
        if whole and (width, height) != (
            call("buffer_get_image_width", buffer),
            call("buffer_get_image_height", buffer),
        ):
            return image, OTHER_SIZE
        ctypes.memmove(image.ctypes.data, data, image.nbytes)
        return image, 0

    def _fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        return DeviceFault(self._device, step, expected=expected, got=got, remedy=remedy)
