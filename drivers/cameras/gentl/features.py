"""Write the settings of an opened GenTL camera, read them back, and refuse a difference."""

from functools import partial
from threading import Lock
from typing import Any

from drivers.cameras.genicam.lines import Lines
from drivers.cameras.genicam.nodes import AUTOMATICS, VERSIONS, agree, printable, snake
from drivers.cameras.gentl.device import Device, GentlError
from drivers.cameras.gentl.settings import GentlSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import Setting

RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
EXPOSURE = ("ExposureTime", "ExposureTimeAbs")
GAIN = ("Gain", "GainAbs", "GainRaw")
"""The names of the features in the standard, and the names that cameras had before it."""
RATE_SWITCHES = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
REGION = ("OffsetX", "OffsetY", "Width", "Height")
ANOTHER = "choose a value that the camera takes"


class Features:
    """The settings (GenICam features) of an opened camera.

    `numbers` has the values of frame rate, exposure time and gain by the names of their features, as read
    back from the camera. A feature that the camera does not have is missing.
    """

    def __init__(
        self, camera: Device, settings: GentlSettings, device: str, clock: Clock, talk: Lock
    ) -> None:
        self._camera = camera
        self._settings = settings
        self._device = device
        self._fault = partial(DeviceFault, device)
        self.numbers: dict[str, float] = {}
        self.lines = Lines(self, settings, device, clock, talk)

    def write(self) -> None:
        """Switch automatic controls and triggers off, and write all settings.

        Raise `DeviceFault` if the camera does not accept a setting, and `LinkLost` if it does not answer.
        """
        settings = self._settings
        for name in AUTOMATICS:
            if name not in settings.features and self.has(name):
                self.set_text(name, "Off")
        for name, value in settings.features.items():
            if not self.has(name):
                raise self._fault(f"set {name}", "a feature of the camera", repr(name), "correct `features`")
            self.set_text(name, value)
        self._switch_triggers_off()
        self.set_text("PixelFormat", settings.format)
        self._set_region()
        for name, value in (("AcquisitionMode", "Continuous"), ("ExposureMode", "Timed")):
            if self.has(name):
                self.set_text(name, value)
        self._set_exposure()
        for name in RATE_SWITCHES:
            if self.has(name):
                self.set_switch(name, True)
        self._set_number(self._one_of(RATE, "rate_hz"), settings.rate_hz)
        self._set_gain()
        self.lines.write()
        self.verify()

    @property
    def exposure_us(self) -> float:
        """Exposure time in µs as read back; NaN if the camera tells none."""
        return next((self.numbers[name] for name in EXPOSURE if name in self.numbers), float("nan"))

    @property
    def gain(self) -> float:
        """Gain as read back, in the unit of the camera; NaN if the camera tells none."""
        return next((self.numbers[name] for name in GAIN if name in self.numbers), float("nan"))

    def verify(self) -> None:
        """Read frame rate, exposure time and gain back, and compare them with the values read after opening.

        Raise `DeviceFault` if a value has changed, for example because another feature was written, and
        `LinkLost` if the camera does not answer.
        """
        for name, wanted in self.numbers.items():
            got = self._asked(f"verify {name}", f"{wanted:g}", self._camera.number, name)
            if not agree(got, wanted):
                raise self._fault(f"verify {name}", f"{wanted:g}", f"{got:g}", "open the camera again")

    def read(self) -> dict[str, Setting]:
        """Read back the settings that `write` has written, and the camera's versions."""
        number = partial(self._asked, "read settings", "its settings", self._camera.number)
        found: dict[str, Setting] = {"format": self.text("PixelFormat")}
        found |= {f"{snake(name)}_px": int(number(name)) for name in REGION if self.has(name)}
        keys = {**dict.fromkeys(RATE, "rate_hz"), **dict.fromkeys(EXPOSURE, "exposure_us")}
        found |= {keys.get(name, "gain"): number(name) for name in self.numbers}
        names = dict.fromkeys([*AUTOMATICS, *VERSIONS, *self._settings.features])
        found |= {f"feature_{snake(name)}": self.text(name) for name in names if self.has(name)}
        return found | self.lines.read()

    def has(self, feature: str) -> bool:
        """Return whether the camera has a feature now."""
        return bool(self._asked(f"look for {feature}", "an answer", self._camera.has, feature))

    def text(self, feature: str) -> str:
        """Return the value of a feature as text."""
        return printable(self._asked(f"read {feature}", "its value", self._camera.text, feature))

    def set_text(self, feature: str, wanted: str) -> None:
        """Set a string or an enumeration, read it back, and raise `DeviceFault` at a difference.

        A value that the camera has already is not written, because it may be fixed.
        """
        if self.text(feature) == wanted:
            return
        self._set(feature, wanted)
        self._require(f"set {feature}", wanted, self.text(feature))

    def set_switch(self, feature: str, on: bool) -> None:
        """Set a feature that is true or false."""
        self._set(feature, on)

    def switch(self, feature: str) -> bool:
        """Return whether a feature is true."""
        return bool(self._asked(f"read {feature}", "its value", self._camera.number, feature))

    def integer(self, feature: str) -> int:
        """Return the value of an integer."""
        return int(self._asked(f"read {feature}", "its value", self._camera.number, feature))

    def execute(self, feature: str) -> None:
        """Execute a command."""
        self._asked(f"execute {feature}", "acceptance", self._camera.execute, feature)

    def _set_exposure(self) -> None:
        name, wanted = next(filter(self.has, EXPOSURE), None), self._settings.exposure_us
        if name is None and wanted is not None:
            got = "a camera that has no exposure time"
            raise self._fault("set exposure_us", EXPOSURE[0], got, "leave out exposure_us")
        if name is not None and wanted is None:
            raise self._fault("set exposure_us", "an exposure time", "none", "give exposure_us")
        if name is not None and wanted is not None:
            self._set_number(name, wanted)

    def _set_gain(self) -> None:
        name, wanted = next(filter(self.has, GAIN), None), self._settings.gain
        if name is None and wanted is not None:
            raise self._fault("set gain", GAIN[0], "a camera that has no gain", "leave out gain")
        if name is not None and wanted is not None:
            self._set_number(name, wanted)
        elif name is not None:
            self.numbers[name] = self._asked("read gain", "its value", self._camera.number, name)

    def _set_region(self) -> None:
        settings = self._settings
        wanted = (settings.offset_x_px, settings.offset_y_px, settings.width_px, settings.height_px)
        # The offset comes first, and at last: a size may only fit beside an offset of 0.
        for name, value in zip((*REGION[:2], *REGION), (0, 0, *wanted), strict=False):
            if self.has(name):
                self._set(name, value)
        got = [self.integer(name) if self.has(name) else 0 for name in REGION]
        words = "{2} x {3} px at ({0}, {1})"
        self._require("set size", words.format(*wanted), words.format(*got))

    def _switch_triggers_off(self) -> None:
        if not self.has("TriggerMode"):
            return
        if not self.has("TriggerSelector"):
            self.set_text("TriggerMode", "Off")
            return
        for entry in self._asked("read triggers", "names", self._camera.entries, "TriggerSelector"):
            self.set_text("TriggerSelector", entry)
            if self.has("TriggerMode"):
                self.set_text("TriggerMode", "Off")

    def _set_number(self, name: str, wanted: float) -> None:
        self._set(name, wanted)
        got = float(self._asked(f"read {name}", "its value", self._camera.number, name))
        if not agree(got, wanted):
            raise self._fault(f"set {name}", f"{wanted:g}", f"{got:g} on reading back", ANOTHER)
        self.numbers[name] = got

    def _one_of(self, names: tuple[str, ...], setting: str) -> str:
        for name in names:
            if self.has(name):
                return name
        raise self._fault(f"set {setting}", names[0], "a camera without it", "use another camera")

    def _set(self, feature: str, value: str | float | bool) -> None:
        try:
            self._camera.set(feature, value)
        except GentlError as error:
            remedy = f"{ANOTHER}, or check its cable"
            raise self._fault(f"set {feature}", "acceptance", str(error), remedy) from error

    def _asked(self, step: str, expected: str, ask: Any, *arguments: Any) -> Any:
        try:
            return ask(*arguments)
        except GentlError as error:
            remedy = "check cable, power and address, and that no other program controls the camera"
            raise LinkLost(self._device, step, expected, str(error), remedy) from error

    def _require(self, step: str, wanted: str, got: str) -> None:
        if got != wanted:
            raise self._fault(step, wanted, f"{got} on reading back", ANOTHER)
