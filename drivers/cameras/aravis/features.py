"""Write the settings of an opened GigE Vision camera, read them back, and refuse a difference."""

import ctypes
import re
from functools import partial
from typing import Any

from drivers.cameras.aravis.library import Aravis, AravisError
from drivers.cameras.aravis.settings import AravisSettings
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import Setting

AUTOMATICS = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto")
VERSIONS = ("DeviceVersion", "DeviceFirmwareVersion")
_NAMES = {"frame_rate": "rate_hz", "exposure_time": "exposure_us", "gain": "gain"}
TEXT_MAX = 200
CONTINUOUS = 0
TOLERANCE = 1e-3
ANOTHER = "choose a value that the camera takes"


class Features:
    """The settings (GenICam features) of an opened camera.

    `camera` is the pointer to the library's camera object. `numbers` has the values of ``frame_rate``,
    ``exposure_time`` and ``gain``, as read back from the camera. There is no ``gain`` if the camera has no
    gain.
    """

    def __init__(self, library: Aravis, camera: int, device: str) -> None:
        self._library = library
        self._camera = camera
        self._device = device
        self._fault = partial(DeviceFault, self._device)
        self.numbers: dict[str, float] = {}

    def write(self, settings: AravisSettings) -> None:
        """Switch the automatic controls off and write all settings.

        Raise `DeviceFault` if the camera does not accept a setting, and `AravisError` if the camera does not
        answer.
        """
        for name in AUTOMATICS:
            if name not in settings.features and self._has(name):
                self._set_text(name, "Off")
        for name, value in settings.features.items():
            if not self._has(name):
                raise self._fault(f"set {name}", "a feature of the camera", repr(name), "correct `features`")
            self._set_text(name, value)
        self.attempt("set format", "camera_set_pixel_format_from_string", settings.format.encode())
        got = self._library.text("camera_get_pixel_format_as_string", self._camera)
        self._require("set format", settings.format, got)
        self._set_region(settings)
        self.attempt("set trigger", "camera_clear_triggers")
        self.attempt("set mode", "camera_set_acquisition_mode", CONTINUOUS)
        self._set_number("frame_rate", settings.rate_hz)
        self._set_number("exposure_time", settings.exposure_us)
        if settings.gain is not None:
            self._set_number("gain", settings.gain)
        elif self._has("Gain") or self._has("GainRaw"):
            self.numbers["gain"] = float(self.attempt("read gain", "camera_get_gain"))
        self.verify()

    def verify(self) -> None:
        """Read frame rate, exposure time and gain back, and compare them with the values read after opening.

        Raise `DeviceFault` if a value has changed, for example because another feature was written, and
        `LinkLost` if the camera does not answer.
        """
        for name, wanted in self.numbers.items():
            step = f"verify {name}"
            try:
                got = float(self._library.call(f"camera_get_{name}", self._camera))
            except AravisError as error:
                raise self._lost(step, f"{wanted:g}", error) from error
            if not _agree(got, wanted):
                raise self._fault(step, f"{wanted:g}", f"{got:g}", "open the camera again")

    def read(self, settings: AravisSettings) -> dict[str, Setting]:
        """Read back the settings that `write` has written, the transfer sizes and the camera's versions.

        Raise `LinkLost` if the camera does not answer.
        """
        try:
            return self._read_picture() | self._read_transfer() | self._read_texts(settings)
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
            **dict(zip(names, self._region(), strict=True)),
            **numbers,
        }

    def _read_transfer(self) -> dict[str, Setting]:
        call, camera = self._library.call, self._camera
        found: dict[str, Setting] = {"payload_bytes": int(call("camera_get_payload", camera))}
        if call("camera_is_gv_device", camera):
            found["packet_bytes"] = int(call("camera_gv_get_packet_size", camera))
        return found

    def _read_texts(self, settings: AravisSettings) -> dict[str, Setting]:
        names = dict.fromkeys([*AUTOMATICS, *VERSIONS, *settings.features])
        return {f"feature_{_snake(name)}": self._text(name) for name in names if self._has(name)}

    def _text(self, feature: str) -> str:
        text = self._library.text("camera_get_string", self._camera, feature.encode())
        return "".join(sign for sign in text if sign.isprintable())[:TEXT_MAX]

    def _lost(self, step: str, expected: str, error: AravisError) -> LinkLost:
        remedy = "check cable, power and address, and that no other program controls the camera"
        return LinkLost(self._device, step, expected, str(error), remedy)

    def attempt(self, step: str, name: str, *arguments: Any) -> Any:
        """Call a library function for the camera. Raise `DeviceFault` if the call fails."""
        try:
            return self._library.call(name, self._camera, *arguments)
        except AravisError as error:
            raise self._fault(step, "acceptance", str(error), f"{ANOTHER}, or check its cable") from error

    def _set_region(self, settings: AravisSettings) -> None:
        wanted = (settings.offset_x_px, settings.offset_y_px, settings.width_px, settings.height_px)
        self.attempt("set size", "camera_set_region", *wanted)
        names = "{2} x {3} px at ({0}, {1})"
        self._require("set size", names.format(*wanted), names.format(*self._region()))

    def _region(self) -> list[int]:
        """Return horizontal and vertical offset, width and height of the picture, in pixels."""
        got = [ctypes.c_int() for _ in range(4)]
        self._library.call("camera_get_region", self._camera, *(ctypes.byref(value) for value in got))
        return [value.value for value in got]

    def _set_number(self, name: str, wanted: float) -> None:
        step = f"set {name}"
        self.attempt(step, f"camera_set_{name}", wanted)
        got = float(self.attempt(step, f"camera_get_{name}"))
        if not _agree(got, wanted):
            raise self._fault(step, f"{wanted:g}", f"{got:g} on reading back", ANOTHER)
        self.numbers[name] = got

    def _set_text(self, name: str, wanted: str) -> None:
        feature = name.encode()
        self.attempt(f"set {name}", "camera_set_string", feature, wanted.encode())
        self._require(f"set {name}", wanted, self._library.text("camera_get_string", self._camera, feature))

    def _has(self, feature: str) -> bool:
        return bool(self._library.call("camera_is_feature_available", self._camera, feature.encode()))

    def _require(self, step: str, wanted: str, got: str) -> None:
        if got != wanted:
            raise self._fault(step, wanted, f"{got} on reading back", ANOTHER)


def _snake(feature: str) -> str:
    """Return the name of a GenICam feature in lower case, with underscores between its words."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|[^A-Za-z0-9]+", "_", feature).strip("_").lower()


def _agree(got: float, wanted: float) -> bool:
    return abs(got - wanted) <= TOLERANCE * max(abs(wanted), TOLERANCE)
