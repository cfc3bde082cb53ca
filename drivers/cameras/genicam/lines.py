"""The lines of a GenICam camera: an input that begins each exposure, and an output for other machines."""

from drivers.cameras.genicam.nodes import Nodes
from drivers.cameras.genicam.settings import GenicamSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Setting

SOFTWARE = "Software"
USER_OUTPUT = "UserOutput"


class Lines:
    """The trigger input and the output line of an opened camera, as the settings want them.

    Parameters
    ----------
    nodes : Nodes
        The features of the camera. The caller lets only one thread use them at a time.
    """

    def __init__(self, nodes: Nodes, settings: GenicamSettings, device: str, clock: Clock) -> None:
        self._nodes = nodes
        self._settings = settings
        self._device = device
        self._clock = clock

    @property
    def gives_pulses(self) -> bool:
        """Whether the program drives the output line."""
        return bool(self._settings.output) and self._settings.output_source.startswith(USER_OUTPUT)

    def write(self) -> None:
        """Set both lines and read them back. Raise `DeviceFault` if the camera has no such line.

        Triggers that the settings do not name must be off before.
        """
        if self._settings.trigger:
            self._write_trigger()
        if self._settings.output:
            self._write_output()

    def read(self) -> dict[str, Setting]:
        """Return what the camera says about the lines that the settings name."""
        found: dict[str, Setting] = {}
        if self._settings.trigger:
            self._select("TriggerSelector", "FrameStart")
            names = ("TriggerMode", "TriggerSource", "TriggerActivation")
            found |= {
                f"trigger_{key}": self._nodes.text(name)
                for key, name in zip(("mode", "source", "edge"), names, strict=True)
                if self._nodes.has(name)
            }
        if self._settings.output:
            self._select("LineSelector", self._settings.output)
            found["output_line"] = self._nodes.text("LineSelector")
            found["output_mode"] = self._nodes.text("LineMode")
            found["output_source"] = self._nodes.text("LineSource")
        return found

    def pulse(self) -> None:
        """Give one pulse on the output line. Raise `DeviceFault` if the program does not drive the line."""
        if not self.gives_pulses:
            raise DeviceFault(
                self._device,
                "pulse",
                "an output line that the program drives",
                repr(self._settings.output_source if self._settings.output else self._settings.output),
                'give output and output_source = "UserOutput1", by the camera\'s own names',
            )
        self._switch(on=True)
        try:
            self._clock.sleep(self._settings.pulse_ms * 1e-3)
        finally:
            self._switch(on=False)

    def rest(self) -> None:
        """Leave the line that the program drives in its state of rest, which is low."""
        if self.gives_pulses:
            self._switch(on=False)

    def _write_trigger(self) -> None:
        self._require("TriggerMode", f"trigger {self._settings.trigger!r}")
        self._select("TriggerSelector", "FrameStart")
        self._nodes.set_text("TriggerSource", self._settings.trigger)
        if self._settings.trigger != SOFTWARE:
            self._nodes.set_text("TriggerActivation", self._settings.trigger_edge)
        self._nodes.set_text("TriggerMode", "On")

    def _write_output(self) -> None:
        self._require("LineSelector", f"output {self._settings.output!r}")
        self._nodes.set_text("LineSelector", self._settings.output)
        if not (self._nodes.has("LineMode") and self._nodes.text("LineMode") == "Output"):
            # the mode of a line that can only give is fixed
            self._require("LineMode", f"output {self._settings.output!r}")
            self._nodes.set_text("LineMode", "Output")
        self._nodes.set_text("LineSource", self._settings.output_source)
        self.rest()

    def _switch(self, *, on: bool) -> None:
        self._require("UserOutputValue", self._settings.output_source)
        self._select("UserOutputSelector", self._settings.output_source)
        self._nodes.set_switch("UserOutputValue", on)

    def _select(self, selector: str, entry: str) -> None:
        """Select the entry that the next features belong to. A camera with one entry may have no selector."""
        if self._nodes.has(selector):
            self._nodes.set_text(selector, entry)

    def _require(self, feature: str, what: str) -> None:
        if not self._nodes.has(feature):
            raise DeviceFault(
                self._device, f"set {what}", f"a camera with {feature}", "none", "leave the setting out"
            )
