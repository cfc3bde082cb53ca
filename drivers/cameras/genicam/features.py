"""What all libraries do with the features of a GenICam camera: write settings, read them back, compare."""

from abc import ABC, abstractmethod
from functools import partial
from threading import Lock

from drivers.cameras.genicam.lines import Lines
from drivers.cameras.genicam.nodes import AUTOMATICS, VERSIONS, Nodes, agree, snake
from drivers.cameras.genicam.settings import GenicamSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Setting

ANOTHER = "choose a value that the camera takes"


class GenicamFeatures(Nodes, ABC):
    """The settings (GenICam features) of an opened camera.

    Attributes
    ----------
    numbers : dict of str to float
        Frame rate, exposure time and gain by their names in the library, as read back from the camera. What
        the camera does not have is missing.
    lines : Lines
        The camera's trigger input and its output line.
    """

    def __init__(self, settings: GenicamSettings, device: str, clock: Clock, talk: Lock) -> None:
        self._given = settings
        self._device = device
        self._fault = partial(DeviceFault, device)
        self.numbers: dict[str, float] = {}
        self.lines = Lines(self, settings, device, clock, talk)

    @abstractmethod
    def number(self, name: str, step: str, expected: str) -> float:
        """Return the value of a number, read from the camera. Raise `LinkLost` if it does not answer."""

    @abstractmethod
    def put_number(self, name: str, value: float) -> None:
        """Write a number. Raise `DeviceFault` if the camera refuses it."""

    @abstractmethod
    def read(self) -> dict[str, Setting]:
        """Read back what was written, and the camera's versions. Raise `LinkLost` if it does not answer."""

    def verify(self) -> None:
        """Read frame rate, exposure time and gain back, and compare them with the values read after opening.

        Raise `DeviceFault` if a value has changed, for example because another feature was written, and
        `LinkLost` if the camera does not answer.
        """
        for name, wanted in self.numbers.items():
            got = self.number(name, f"verify {name}", f"{wanted:g}")
            if not agree(got, wanted):
                raise self._fault(f"verify {name}", f"{wanted:g}", f"{got:g}", "open the camera again")

    def _write_texts(self) -> None:
        """Switch automatic controls off, and write the features that the settings name."""
        named = self._given.features
        for name in AUTOMATICS:
            if name not in named and self.has(name):
                self.set_text(name, "Off")
        for name, value in named.items():
            if not self.has(name):
                raise self._fault(f"set {name}", "a feature of the camera", repr(name), "correct `features`")
            self.set_text(name, value)

    def _read_texts(self) -> dict[str, Setting]:
        names = dict.fromkeys([*AUTOMATICS, *VERSIONS, *self._given.features])
        return {f"feature_{snake(name)}": self.text(name) for name in names if self.has(name)}

    def _set_number(self, name: str, wanted: float) -> None:
        self.put_number(name, wanted)
        got = self.number(name, f"set {name}", f"{wanted:g}")
        if not agree(got, wanted):
            raise self._fault(f"set {name}", f"{wanted:g}", f"{got:g} on reading back", ANOTHER)
        self.numbers[name] = got

    @property
    def _region(self) -> tuple[int, int, int, int]:
        """Horizontal and vertical offset, width and height in px, as the settings want them."""
        given = self._given
        return given.offset_x_px, given.offset_y_px, given.width_px, given.height_px

    def _require_region(self, got: list[int]) -> None:
        words = "{2} x {3} px at ({0}, {1})"
        self._require("set size", words.format(*self._region), words.format(*got))

    def _require(self, step: str, wanted: str, got: str) -> None:
        if got != wanted:
            raise self._fault(step, wanted, f"{got} on reading back", ANOTHER)
