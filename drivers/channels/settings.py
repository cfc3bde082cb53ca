"""The settings that the signals of all channel devices share, and the values in the signals' units."""

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from drivers.settings import Settings
from drivers.signals import Signal

MOST_SIGNALS = 64


class SignalSettings(Settings):
    """One signal of a channel device in the rig file. A driver adds the keys that name its input.

    The value is what the input delivers × `scale` + `offset`, in `unit`.
    """

    unit: str = Field(min_length=1, max_length=20, description="unit of the value, such as N, mm or °C")
    scale: float = Field(default=1.0, description="change of the value per unit of the input")
    offset: float = Field(default=0.0, description="value at an input of 0")
    range: list[float] = Field(
        min_length=2, max_length=2, description="lowest and highest valid value, in `unit`; beyond is a fault"
    )
    delay_s: float = Field(default=0.0, ge=0.0, le=10.0, description="time by which the value lags behind")
    delay_std_s: float = Field(default=0.0, ge=0.0, le=10.0, description="standard deviation of the delay")
    std: float = Field(default=0.0, ge=0.0, description="standard deviation of the noise, in `unit`")

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.scale == 0.0:
            raise ValueError("scale must not be 0, because every value would be the offset")
        low, high = self.range
        if not low < high:
            raise ValueError(f"range: the lowest value before the highest is expected, got {self.range}")
        return self

    def signal(self, name: str) -> Signal:
        """Return the signal with this name."""
        low, high = self.range
        return Signal(name, self.unit, low, high, self.delay_s, self.delay_std_s, self.std)


def signal_names(signals: Mapping[str, SignalSettings]) -> Mapping[str, SignalSettings]:
    """Check the names of the tables `[….signals.NAME]`. Raise `ValueError` for pydantic."""
    for name in signals:
        if not name.isidentifier():
            raise ValueError(f"{name!r}: a name of letters, digits and _ is expected, such as force")
    return signals


class ChannelSettings(Settings):
    """Base of the settings of a channel device. A driver declares `signals` with its own kind of signal."""

    signals: Mapping[str, SignalSettings] = Field(min_length=1, max_length=MOST_SIGNALS)

    @field_validator("signals")
    @classmethod
    def _named(cls, signals: Mapping[str, SignalSettings]) -> Mapping[str, SignalSettings]:
        return signal_names(signals)

    @property
    def declared(self) -> tuple[Signal, ...]:
        """The signals, in the order of the rig file."""
        return tuple(each.signal(name) for name, each in self.signals.items())

    def in_units(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values (…, signals) in the signals' units, from what the inputs deliver."""
        scales, offsets = np.array([(each.scale, each.offset) for each in self.signals.values()]).T
        return np.asarray(inputs * scales + offsets)
