"""The lines of a GenICam camera: an input that begins each exposure, and an output for other machines."""

from contextlib import suppress
from threading import Lock

from drivers.cameras.genicam.nodes import Nodes
from drivers.cameras.genicam.settings import GenicamSettings
from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import Setting
from drivers.lines.pulse_line import PulseLine

SOFTWARE = "Software"


class Lines:
    """The trigger input and the output line of an opened camera, as the settings want them.

    Parameters
    ----------
    nodes : Nodes
        The features of the camera.
    settings : GenicamSettings
    device : str
        Name of the camera in messages.
    clock : Clock
    talk : Lock
        Held by the thread that uses the features. The caller holds it for `read`, but not for the other
        methods, because a pulse may come while another thread takes the frames of a stream.
    """

    def __init__(
        self, nodes: Nodes, settings: GenicamSettings, device: str, clock: Clock, talk: Lock
    ) -> None:
        self._nodes = nodes
        self._settings = settings
        self._device = device
        self._talk = talk
        width_key = f"pulse_ms = {settings.pulse_ms:g}"
        self._line = PulseLine(device, clock, settings.pulse_ms * 1e-3, width_key, self._switch)

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
        """Begin a pulse on the output line and return; the pulse ends by itself after `pulse_ms`.

        Raise `DeviceFault` if the program does not drive the line, or if the pulse before has not ended, and
        another `DeviceError` if the pulse may not have been given.
        """
        if not self._settings.gives_pulses:
            raise DeviceFault(
                self._device,
                "pulse",
                "an output line that the program drives",
                repr(self._settings.output_source if self._settings.output else self._settings.output),
                'give output and output_source = "UserOutput1", by the camera\'s own names',
            )
        self._line.pulse()

    def close(self) -> None:
        """Leave the line that the program drives in its state of rest, which is low. Raise no error."""
        if self._settings.gives_pulses:
            with suppress(DeviceError):  # those of a camera that is gone
                self._line.close()

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
        if self._settings.gives_pulses:
            self._line.rest()

    def _switch(self, on: bool, step: str) -> None:
        with self._talk:
            self._require("UserOutputValue", self._settings.output_source)
            self._select("UserOutputSelector", self._settings.output_source)
            self._nodes.set_switch("UserOutputValue", on)
            if self._nodes.switch("UserOutputValue") is not on:
                raise DeviceFault(
                    self._device,
                    step,
                    f"UserOutputValue {on}",
                    f"{not on} on reading back",
                    "check that no other program uses the camera",
                )

    def _select(self, selector: str, entry: str) -> None:
        """Select the entry that the next features belong to. A camera with one entry may have no selector."""
        if self._nodes.has(selector):
            self._nodes.set_text(selector, entry)

    def _require(self, feature: str, what: str) -> None:
        if not self._nodes.has(feature):
            raise DeviceFault(
                self._device, f"set {what}", f"a camera with {feature}", "none", "leave the setting out"
            )
