"""Write the settings of an opened GenTL camera, read them back, and refuse a difference."""

from threading import Lock
from typing import Any

from drivers.cameras.genicam.features import ANOTHER, GenicamFeatures
from drivers.cameras.genicam.nodes import printable, snake
from drivers.cameras.gentl.device import Device, GentlError
from drivers.cameras.gentl.settings import GentlSettings
from drivers.clock import Clock
from drivers.errors import LinkLost
from drivers.interfaces import Setting

RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
EXPOSURE = ("ExposureTime", "ExposureTimeAbs")
GAIN = ("Gain", "GainAbs", "GainRaw")
"""The names of the features in the standard, and the names that cameras had before it."""
RATE_SWITCHES = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
REGION = ("OffsetX", "OffsetY", "Width", "Height")


class Features(GenicamFeatures):
    """The settings of an opened camera. `numbers` has the names of the standard, or those from before it."""

    def __init__(
        self, camera: Device, settings: GentlSettings, device: str, clock: Clock, talk: Lock
    ) -> None:
        super().__init__(settings, device, clock, talk)
        self._camera = camera
        self._settings = settings

    def write(self) -> None:
        """Switch automatic controls and triggers off, and write all settings.

        Raise `DeviceFault` if the camera does not accept a setting, and `LinkLost` if it does not answer.
        """
        settings = self._settings
        self._write_texts()
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

    def read(self) -> dict[str, Setting]:
        """Read back the settings that `write` has written, and the camera's versions."""
        step, expected = "read settings", "its settings"
        found: dict[str, Setting] = {"format": self.text("PixelFormat")}
        regions = [name for name in REGION if self.has(name)]
        found |= {f"{snake(name)}_px": int(self.number(name, step, expected)) for name in regions}
        keys = {**dict.fromkeys(RATE, "rate_hz"), **dict.fromkeys(EXPOSURE, "exposure_us")}
        found |= {keys.get(name, "gain"): self.number(name, step, expected) for name in self.numbers}
        return found | self._read_texts() | self.lines.read()

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
        return bool(self.number(feature, f"read {feature}", "its value"))

    def integer(self, feature: str) -> int:
        """Return the value of an integer."""
        return int(self.number(feature, f"read {feature}", "its value"))

    def number(self, name: str, step: str, expected: str) -> float:
        """Return the value of a number, read from the camera."""
        return float(self._asked(step, expected, self._camera.number, name))

    def put_number(self, name: str, value: float) -> None:
        """Write a number."""
        self._set(name, value)

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
            self.numbers[name] = self.number(name, "read gain", "its value")

    def _set_region(self) -> None:
        # The offset comes first, and at last: a size may only fit beside an offset of 0.
        for name, value in zip((*REGION[:2], *REGION), (0, 0, *self._region), strict=False):
            if self.has(name):
                self._set(name, value)
        self._require_region([self.integer(name) if self.has(name) else 0 for name in REGION])

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
