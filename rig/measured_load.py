"""The table [load_frame] of a rig whose load frame is only read: load and displacement are channels."""

from collections.abc import Mapping

from pydantic import Field

from drivers.settings import Settings
from drivers.signals import Signal

PREFIX = "channels."
_UNITS = {"load": "N", "displacement": "mm"}


class MeasuredLoad(Settings):
    """The signals that are the load and the displacement of a machine which takes no commands."""

    load: str = Field(description="signal of the load, such as channels.force; its unit is N")
    displacement: str | None = Field(default=None, description="signal of the crosshead; its unit is mm")

    @property
    def signals(self) -> dict[str, str]:
        """The names of the signals, by their quantities."""
        given = {"load": self.load, "displacement": self.displacement}
        return {quantity: name.removeprefix(PREFIX) for quantity, name in given.items() if name is not None}

    def mistakes(self, signals: Mapping[str, Signal]) -> list[str]:
        """Return one sentence for each quantity whose signal is missing or has another unit."""
        found = []
        known = ", ".join(PREFIX + name for name in signals) or "none"
        for quantity, name in self.signals.items():
            unit = _UNITS[quantity]
            if not getattr(self, quantity).startswith(PREFIX) or name not in signals:
                found.append(
                    f"load_frame.{quantity}: a signal of the rig is expected ({known}), "
                    f"got {getattr(self, quantity)!r}"
                )
            elif signals[name].unit != unit:
                found.append(
                    f"load_frame.{quantity}: a signal in {unit} is expected, {PREFIX}{name} is in "
                    f"{signals[name].unit}; set its scale and unit so that its values are in {unit}"
                )
        return found
