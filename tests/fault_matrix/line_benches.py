"""Benches of the output lines of cameras, which are trigger outputs of a rig."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from tests.fault_matrix.bench import WrongAnswerError
from tests.fault_matrix.camera_benches import AravisBench, GentlBench, NumberedBench

WIDTH_S = 0.05
LINE = {
    "LineSelector": "Line1",
    "LineMode": "Input",
    "LineSource": "Off",
    "UserOutputSelector": "UserOutput0",
    "UserOutputValue": False,
}
"""The features of a camera that has an output line."""


class LineBench(NumberedBench):
    """The output line of a camera, as a trigger output of the rig; faults of frames must not touch it."""

    more: Mapping[str, Any] = {"output": "Line2", "output_source": "UserOutput1", "pulse_ms": 1e3 * WIDTH_S}

    def __init__(self) -> None:
        super().__init__()
        self._asked = 0
        self.uses = {"line": self._pulse}
        self.fake.values |= LINE

    @property
    @abstractmethod
    def fake(self) -> Any:
        """The simulated camera."""

    def prepare(self) -> None:
        """Give one pulse."""
        self._pulse()

    def works(self) -> None:
        """Give two pulses, each of which must end."""
        for _ in range(2):
            self._pulse()
            if self._switched[-1]:
                raise WrongAnswerError("the pulse did not end")

    def executed_twice(self) -> list[str]:
        """Return a pulse if more have begun than were asked for."""
        return ["pulse"] if sum(self._switched) > self._asked else []

    @property
    def _switched(self) -> list[bool]:
        return [on for _, feature, on in self.fake.switched if feature == "UserOutputValue"]

    def _pulse(self) -> None:
        begun = sum(self._switched)
        self._asked += 1
        try:
            self.driver.pulse()
        finally:
            # simulated time stands still until the thread that ends the pulse has done so
            self.clock.sleep(10 * WIDTH_S)
        if sum(self._switched) != begun + 1:
            raise WrongAnswerError(f"{sum(self._switched) - begun} pulses")


class AravisLineBench(LineBench, AravisBench):
    """The output line of a camera with the driver `aravis`."""

    @property
    def fake(self) -> Any:
        """The simulated library."""
        return self._library


class GentlLineBench(LineBench, GentlBench):
    """The output line of a camera with the driver `gentl`."""

    @property
    def fake(self) -> Any:
        """The simulated camera."""
        return self.camera
