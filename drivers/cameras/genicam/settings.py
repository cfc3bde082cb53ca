"""Rig-file settings that all GenICam cameras share."""

from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.cameras.settings import DatedFrameSettings

USER_OUTPUT = "UserOutput"
"""Beginning of the names of the line sources that the program switches."""
BITS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono14": 14, "Mono16": 16}


class GenicamSettings(DatedFrameSettings):
    """Settings of a camera. The driver switches off the automatic controls that change grey levels.

    With `trigger`, `rate_hz` is the highest rate at which triggers come.
    """

    # the camera: its address, serial number or another name, see the driver's settings
    camera: str = Field(min_length=1)
    # GenICam pixel format. Only unpacked grey-level formats are supported.
    format: Literal["Mono8", "Mono10", "Mono12", "Mono14", "Mono16"] = "Mono8"
    # offset of the picture on the sensor
    offset_x_px: int = Field(default=0, ge=0)
    offset_y_px: int = Field(default=0, ge=0)
    # gain in the unit of the camera (often dB). Without this setting, the driver does not change the gain and
    # records its value.
    gain: float | None = None
    # further GenICam features of type string or enumeration, and their values. An automatic control that is
    # named in `features` gets the given value and is not switched off.
    features: dict[str, str] = Field(default_factory=dict)
    buffers: int = Field(default=8, ge=2, le=64)
    # input line that begins each exposure, by the camera's own name such as "Line1"; "Software" for the
    # camera's own command. Empty for a camera that films at `rate_hz`.
    trigger: str = ""
    trigger_edge: Literal["RisingEdge", "FallingEdge"] = "RisingEdge"
    # output line, by the camera's own name such as "Line2", and what drives it: "ExposureActive" is high
    # during each exposure; with "UserOutput0" and others, the program gives the pulses.
    output: str = ""
    output_source: str = Field(default="ExposureActive", min_length=1)
    pulse_ms: float = Field(default=10.0, gt=0, le=1000)
    # what the camera's own time stamp of a frame marks, from its manual. With "arrival", the driver does not
    # use the camera's clock but the time at which the frame arrives.
    stamp: Literal["arrival", "start", "end"] = "arrival"

    @property
    def bits(self) -> int:
        """Number of significant bits per pixel, used to estimate the amount of data of a run."""
        return BITS[self.format]

    @property
    def gives_pulses(self) -> bool:
        """Whether the program drives the output line, so that the camera can be a trigger output."""
        return bool(self.output) and self.output_source.startswith(USER_OUTPUT)

    @property
    def transfer_s(self) -> float:
        """Longest time from the end of exposure to the arrival of the frame; one frame time if not given."""
        return 1 / self.rate_hz if self.transfer_us is None else self.transfer_us * 1e-6

    @model_validator(mode="after")
    def _lines_are_named(self) -> Self:
        given = self.model_fields_set
        if not self.trigger and "trigger_edge" in given:
            raise ValueError("trigger_edge needs trigger, the name of an input line")
        if not self.output and given & {"output_source", "pulse_ms"}:
            raise ValueError("output_source and pulse_ms need output, the name of an output line")
        if self.output and self.output == self.trigger:
            raise ValueError("output and trigger must be different lines")
        return self
