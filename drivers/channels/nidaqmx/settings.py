"""The settings of the voltage inputs of an NI-DAQmx device."""

from collections.abc import Mapping
from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.channels.settings import ChannelSettings, SignalSettings

Terminals = Literal["default", "differential", "rse", "nrse", "pseudo-differential"]
_ROUNDING = 1e-9


class NidaqmxSignal(SignalSettings):
    """One voltage input. The value is the voltage in V × `scale` + `offset`."""

    input: str = Field(pattern=r"^ai[0-9]{1,3}$", description="name of the input, such as ai0")
    terminals: Terminals = Field(default="default", description="how the input is wired")
    volts: float = Field(default=10.0, gt=0, le=100, description="largest voltage: the device's input range")

    @model_validator(mode="after")
    def _shown(self) -> Self:
        # An input at the end of its range shows this end. It must not look like a value.
        ends = sorted(sign * self.volts * self.scale + self.offset for sign in (-1.0, 1.0))
        margin = _ROUNDING * (ends[1] - ends[0])
        if self.range[0] < ends[0] - margin or self.range[1] > ends[1] + margin:
            raise ValueError(
                f"range: within {ends[0]:g} to {ends[1]:g} {self.unit} is expected, which is what "
                f"±{self.volts:g} V can show; got {self.range}"
            )
        return self


class NidaqmxSettings(ChannelSettings):
    """Settings of the voltage inputs of an NI-DAQmx device."""

    device: str = Field(
        pattern=r"^[A-Za-z0-9_-]{1,80}$", description="name of the device in NI MAX, such as Dev1"
    )
    signals: Mapping[str, NidaqmxSignal] = Field(min_length=1, max_length=64)
    rate_hz: float = Field(ge=1, le=1e6, description="samples per second; the device may choose a near one")
    block_s: float = Field(default=0.05, ge=0.001, le=1, description="duration of the samples read at once")
    buffer_s: float = Field(default=10.0, ge=1, le=600, description="for how long the program may be busy")

    @property
    def block(self) -> int:
        """Number of samples that are read at once."""
        return max(1, round(self.block_s * self.rate_hz))

    @property
    def buffer(self) -> int:
        """Number of samples for which the library's buffer is made."""
        return max(10 * self.block, round(self.buffer_s * self.rate_hz))
