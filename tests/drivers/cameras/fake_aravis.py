"""A simulated Aravis library for the tests of the driver, with a camera that films on the virtual clock.

All pixels of a picture have the picture's number as grey level.
"""

from typing import Any

import numpy as np

from drivers.cameras.aravis.library import AravisError
from drivers.clock import VirtualClock

WIDTH, HEIGHT, INTERVAL_S = 32, 16, 1 / 32
MISSING_PACKETS = 3  # of ArvBufferStatus; compared with the library's own in tests/real_cameras/gige


class FakeLibrary:
    """Simulates the functions of the Aravis library that the driver calls.

    `keeps` holds settings that read back with another value. `status` holds the status of frames by number.
    `waiting` lists the frames that come first. `switched` lists what was switched on or off, and when.
    `losing` is the number of the next switches whose answers are lost.
    `dated` holds timestamps of frames from before the system's date was changed.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.values: dict[str, Any] = {"ExposureAuto": "Continuous", "Gain": 3.0}
        self.keeps: dict[str, Any] = {}
        self.status: dict[int, int] = {}
        self.serial = "G1"
        self.silent = self.gone = self.controlled = False
        self.first_id = 1
        self.begun_s = 0.0
        self.taken = -1
        self.size = (WIDTH, HEIGHT)
        self.held = 0
        self.lent = 0
        self.waiting: list[int] = []
        self.dated: dict[int, int] = {}
        self.pixels = np.zeros((HEIGHT, WIDTH), np.uint16)
        self.latch_s = 1e-3
        self.losing = 0
        self.switched: list[tuple[float, str, bool]] = []

    def text(self, name: str, *arguments: Any) -> str:
        answers = {
            "camera_get_vendor_name": "Maker",
            "camera_get_model_name": "Gige",
            "camera_get_device_serial_number": self.serial,
            "camera_get_pixel_format_as_string": self.values.get("format", ""),
        }
        return answers[name] if name in answers else str(self.values[arguments[-1].decode()])

    def release(self, thing: int | None) -> None:
        self.held -= thing is not None

    def call(self, name: str, *arguments: Any) -> Any:
        if self.gone and name.startswith("camera"):
            raise AravisError("Device not found")
        return getattr(self, name)(
            *arguments[1 if name.startswith("camera_") and name != "camera_new" else 0 :]
        )

    def camera_new(self, name: bytes) -> int:
        self.held += 1
        return 1

    def camera_create_stream(self, *_: object) -> int:
        self.held += 1
        return 2

    def camera_is_gv_device(self) -> bool:
        return True

    def camera_get_device(self) -> int:
        return 3

    def gv_device_is_controller(self, device: int) -> bool:
        return not self.controlled

    def camera_is_feature_available(self, name: bytes) -> bool:
        return name.decode() in self.values

    def camera_set_string(self, name: bytes, value: bytes) -> None:
        self.values[name.decode()] = self.keeps.get(name.decode(), value.decode())

    def camera_set_boolean(self, name: bytes, value: int) -> None:
        feature, on = name.decode(), bool(value)
        self.values[feature] = self.keeps.get(feature, on)
        self.switched.append((self.clock.now_s(), feature, self.values[feature]))
        if self.losing:
            self.losing -= 1
            raise AravisError("Timeout")

    def camera_get_boolean(self, name: bytes) -> int:
        return int(self.values[name.decode()])

    def camera_get_integer(self, name: bytes) -> int:
        return int(self.values[name.decode()])

    def camera_execute_command(self, name: bytes) -> None:
        """Latch the camera's clock, which takes its time on the way there and back."""
        assert name == b"TimestampLatch"
        self.clock.sleep(self.latch_s / 2)
        self.values["TimestampLatchValue"] = round(self.camera_s(self.clock.now_s()) * 1e9)
        self.clock.sleep(self.latch_s / 2)

    def camera_s(self, time_s: float) -> float:
        """Return a time on the camera's own clock, which goes wrong by 40 µs per second."""
        return 7.0 + time_s * (1.0 + 40e-6)

    def camera_set_pixel_format_from_string(self, value: bytes) -> None:
        self.values["format"] = self.keeps.get("format", value.decode())

    def camera_set_region(self, *region: int) -> None:
        self.values["region"] = self.keeps.get("region", region)

    def camera_get_region(self, *out: Any) -> None:
        for pointer, value in zip(out, self.values["region"], strict=True):
            pointer._obj.value = value

    def camera_gv_get_packet_size(self) -> int:
        return 1400

    def camera_start_acquisition(self) -> None:
        self.begun_s, self.taken = self.clock.now_s(), -1

    def stream_try_pop_buffer(self, stream: int) -> int:
        """Return the next frame. This library keeps only the newest frame."""
        newest = int((self.clock.now_s() - self.begun_s) / INTERVAL_S) - 1
        if self.silent or newest <= self.taken:
            return 0
        self.lent += 1
        self.taken = newest if newest - self.taken > 3 else self.taken + 1
        return 100 + self.taken

    def stream_timeout_pop_buffer(self, stream: int, timeout_us: int) -> int:
        if self.waiting:
            return self.waiting.pop(0)
        end_s = self.clock.now_s() + timeout_us * 1e-6
        while self.clock.now_s() < end_s:
            buffer = self.stream_try_pop_buffer(stream)
            if buffer:
                return buffer
            self.clock.sleep(INTERVAL_S / 8)
        return 0

    def stream_push_buffer(self, stream: int, buffer: int) -> None:
        self.lent -= 1

    def buffer_get_frame_id(self, buffer: int) -> int:
        return (buffer - 100 + self.first_id - 1) % 65535 + 1

    def buffer_get_system_timestamp(self, buffer: int) -> int:
        if buffer in self.dated:
            return self.dated[buffer]
        at_s = self.begun_s + (buffer - 100) * INTERVAL_S
        return round((self.clock.utc().timestamp() - self.clock.now_s() + at_s) * 1e9)

    def buffer_get_timestamp(self, buffer: int) -> int:
        return round(self.camera_s(self.begun_s + (buffer - 100) * INTERVAL_S) * 1e9)

    def buffer_get_status(self, buffer: int) -> int:
        return self.status.get(buffer - 100, 0)

    def buffer_get_data(self, buffer: int, size: Any) -> int:
        size._obj.value = self.pixels.nbytes
        self.pixels[:] = (buffer - 100) % 2**16
        return int(self.pixels.ctypes.data)

    def buffer_get_image_width(self, buffer: int) -> int:
        return self.size[0]

    def buffer_get_image_height(self, buffer: int) -> int:
        return self.size[1]

    def __getattr__(self, name: str) -> Any:
        setting = name.removeprefix("camera_set_")
        if setting in ("frame_rate", "exposure_time", "gain"):
            return lambda value: self.values.__setitem__(setting, self.keeps.get(setting, value))
        setting = name.removeprefix("camera_get_")
        if setting in ("frame_rate", "exposure_time", "gain"):
            return lambda: self.values.get(setting, 3.0)
        if name == "camera_get_payload":
            return lambda: WIDTH * HEIGHT * 2
        known = ("clear_triggers", "set_acquisition_mode", "stop_acquisition", "new_allocate")
        if name.endswith(known):
            return lambda *_: 1
        raise AttributeError(name)
