"""Write the settings of an opened GigE Vision camera, read them back, and refuse a difference."""

import ctypes
from threading import Lock
from typing import Any

from drivers.cameras.aravis.library import Aravis, AravisError
from drivers.cameras.aravis.settings import AravisSettings
from drivers.cameras.genicam.features import ANOTHER, GenicamFeatures
from drivers.cameras.genicam.nodes import printable
from drivers.clock import Clock
from drivers.errors import LinkLost
from drivers.interfaces import Setting

_NAMES = {"frame_rate": "rate_hz", "exposure_time": "exposure_us", "gain": "gain"}
CONTINUOUS = 0


class Features(GenicamFeatures):
    """The settings of an opened camera, whose pointer in the library is `camera`.

    `numbers` has ``frame_rate``, ``exposure_time`` and, if the camera has one, ``gain``.
    """

    def __init__(
        self, library: Aravis, camera: int, settings: AravisSettings, device: str, clock: Clock, talk: Lock
    ) -> None:
        super().__init__(settings, device, clock, talk)
        self._library = library
        self._camera = camera
        self._settings = settings

    def write(self) -> None:
        """Switch the automatic controls off and write all settings.

        Raise `DeviceFault` if the camera does not accept a setting, and `AravisError` if the camera does not
        answer.
        """
        settings = self._settings
        self._write_texts()
        self.attempt("set format", "camera_set_pixel_format_from_string", settings.format.encode())
        got = self._library.text("camera_get_pixel_format_as_string", self._camera)
        self._require("set format", settings.format, got)
        self.attempt("set size", "camera_set_region", *self._region)
        self._require_region(self._read_region())
        self.attempt("set trigger", "camera_clear_triggers")
        self.attempt("set mode", "camera_set_acquisition_mode", CONTINUOUS)
        self._set_number("frame_rate", settings.rate_hz)
        self._set_number("exposure_time", settings.exposure_us)
        if settings.gain is not None:
            self._set_number("gain", settings.gain)
        elif self.has("Gain") or self.has("GainRaw"):
            self.numbers["gain"] = float(self.attempt("read gain", "camera_get_gain"))
        # Aravis switches a trigger off when it sets the rate.
        self.lines.write()
        self.verify()

    def read(self) -> dict[str, Setting]:
        """Read back the settings that `write` has written, the transfer sizes and the camera's versions.

        Raise `LinkLost` if the camera does not answer.
        """
        try:
            return self._read_picture() | self._read_transfer() | self._read_texts() | self.lines.read()
        except AravisError as error:
            raise self._lost("read settings", "its settings", error) from error

    def _read_picture(self) -> dict[str, Setting]:
        names = ("offset_x_px", "offset_y_px", "width_px", "height_px")
        numbers = {
            _NAMES[name]: float(self._library.call(f"camera_get_{name}", self._camera))
            for name in self.numbers
        }
        return {
            "format": self._library.text("camera_get_pixel_format_as_string", self._camera),
            **dict(zip(names, self._read_region(), strict=True)),
            **numbers,
        }

    def _read_transfer(self) -> dict[str, Setting]:
        call, camera = self._library.call, self._camera
        found: dict[str, Setting] = {"payload_bytes": int(call("camera_get_payload", camera))}
        if call("camera_is_gv_device", camera):
            found["packet_bytes"] = int(call("camera_gv_get_packet_size", camera))
        return found

    def has(self, feature: str) -> bool:
        """Return whether the camera has a feature now."""
        return bool(self._asked(f"look for {feature}", "is_feature_available", feature))

    def text(self, feature: str) -> str:
        """Return the value of a feature as text."""
        return printable(self._library.text("camera_get_string", self._camera, feature.encode()))

    def set_text(self, feature: str, wanted: str) -> None:
        """Set a string or an enumeration, read it back, and raise `DeviceFault` at a difference."""
        step = f"set {feature}"
        self.attempt(step, "camera_set_string", feature.encode(), wanted.encode())
        self._require(step, wanted, self.text(feature))

    def set_switch(self, feature: str, on: bool) -> None:
        """Set a feature that is true or false."""
        self.attempt(f"set {feature}", "camera_set_boolean", feature.encode(), int(on))

    def switch(self, feature: str) -> bool:
        """Return whether a feature is true."""
        return bool(self._asked(f"read {feature}", "get_boolean", feature))

    def integer(self, feature: str) -> int:
        """Return the value of an integer."""
        return int(self.attempt(f"read {feature}", "camera_get_integer", feature.encode()))

    def number(self, name: str, step: str, expected: str) -> float:
        """Return frame rate, exposure time or gain."""
        try:
            return float(self._library.call(f"camera_get_{name}", self._camera))
        except AravisError as error:
            raise self._lost(step, expected, error) from error

    def put_number(self, name: str, value: float) -> None:
        """Write frame rate, exposure time or gain."""
        self.attempt(f"set {name}", f"camera_set_{name}", value)

    def execute(self, feature: str) -> None:
        """Execute a command."""
        self.attempt(f"execute {feature}", "camera_execute_command", feature.encode())

    def _asked(self, step: str, name: str, feature: str) -> Any:
        """Ask for a feature. Raise `LinkLost` if the camera does not answer."""
        try:
            return self._library.call(f"camera_{name}", self._camera, feature.encode())
        except AravisError as error:
            raise self._lost(step, "an answer of the camera", error) from error

    def _lost(self, step: str, expected: str, error: AravisError) -> LinkLost:
        remedy = "check cable, power and address, and that no other program controls the camera"
        return LinkLost(self._device, step, expected, str(error), remedy)

    def attempt(self, step: str, name: str, *arguments: Any) -> Any:
        """Call a library function for the camera. Raise `DeviceFault` if the call fails."""
        try:
            return self._library.call(name, self._camera, *arguments)
        except AravisError as error:
            raise self._fault(step, "acceptance", str(error), f"{ANOTHER}, or check its cable") from error

    def _read_region(self) -> list[int]:
        """Return horizontal and vertical offset, width and height of the picture, in pixels."""
        got = [ctypes.c_int() for _ in range(4)]
        self._library.call("camera_get_region", self._camera, *(ctypes.byref(value) for value in got))
        return [value.value for value in got]
