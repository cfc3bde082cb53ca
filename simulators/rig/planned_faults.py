"""Faults that begin at a time or in a state of the specimen, and not when somebody switches them on."""

import threading
from dataclasses import dataclass
from typing import Literal, get_args

from pydantic import Field, model_validator

from drivers.settings import Settings
from simulators.rig.picture_faults import PictureFaults
from simulators.scene.specimen import SpecimenState
from simulators.wire.faults import PICTURE, parse
from simulators.wire.rig_faults import RigFaults

Quantity = Literal["displacement_mm", "load_n", "axial_strain", "transverse_strain", "thickness_strain"]
_WHEN = "after SECONDS, or when QUANTITY above NUMBER (or below)"


class FaultPlan(Settings):
    """A table ``[[simulation.faults]]``: a fault, and when it begins."""

    fault: str = Field(description="such as picture.cover@off_axis: see rig simulate --list-faults")
    after_s: float | None = Field(default=None, ge=0, description="time after the rig was opened")
    when: Quantity | None = Field(default=None, description="quantity of the specimen's true state")
    above: float | None = None
    below: float | None = None

    @model_validator(mode="after")
    def _has_one_beginning(self) -> "FaultPlan":
        device, _, fault = self.fault.partition(".")
        parse(fault.partition("@")[0] if device == PICTURE else fault)
        if (self.after_s is None) == (self.when is None):
            raise ValueError("either after_s or when is expected")
        if (self.when is not None) != ((self.above is None) != (self.below is None)):
            raise ValueError("above or below is expected with when, and only with it")
        return self

    @classmethod
    def read(cls, text: str) -> "FaultPlan":
        """Read ``FAULT after SECONDS`` or ``FAULT when QUANTITY above NUMBER``; raise `ValueError`."""
        fault, *words = text.split()
        try:
            match words:
                case ["after", seconds]:
                    return cls(fault=fault, after_s=float(seconds))
                case ["when", quantity, "above" | "below" as side, number] if quantity in get_args(Quantity):
                    return cls.model_validate({"fault": fault, "when": quantity, side: float(number)})
        except ValueError as error:
            raise ValueError(f"fault {text!r}: expected {_WHEN}, got {error}") from error
        quantities = ", ".join(get_args(Quantity))
        raise ValueError(f"fault {text!r}: expected FAULT {_WHEN}; quantities: {quantities}")

    def __str__(self) -> str:
        if self.after_s is not None:
            return f"{self.fault} after {self.after_s:g} s"
        side, value = ("above", self.above) if self.above is not None else ("below", self.below)
        return f"{self.fault} when {self.when} {side} {value:g}"

    def begins(self, now_s: float, opened_s: float, state: SpecimenState) -> float | None:
        """Return the time at which the fault begins, None if it does not begin by now."""
        if self.after_s is not None:
            return opened_s + self.after_s if now_s >= opened_s + self.after_s else None
        assert self.when is not None
        value = getattr(state, self.when)
        reached = value > self.above if self.above is not None else value < self.below
        return now_s if reached else None


@dataclass
class PlannedFaults:
    """The faults of a rig that will begin by themselves. The cameras look for them at each exposure.

    A fault with a time begins at exactly this time. A fault with a state begins when a camera sees the state.
    `opened_s` is the time at which the rig was opened.
    """

    plans: list[FaultPlan]
    faults: RigFaults
    pictures: PictureFaults
    opened_s: float

    def __post_init__(self) -> None:
        self.begun: list[tuple[float, str]] = []
        self._lock = threading.Lock()
        # The names of all cameras are known when the first one exposes.
        self._checked = False

    def add(self, plan: FaultPlan) -> None:
        """Add a plan; raise `ValueError` if its device or camera does not exist."""
        self._require(plan)
        with self._lock:
            self.plans.append(plan)

    def check(self) -> None:
        """Raise `ValueError` if the device or the camera of a plan does not exist."""
        for plan in self.plans:
            self._require(plan)

    def look(self, now_s: float, state: SpecimenState) -> None:
        """Switch on the faults that have begun by now, a time on the rig's clock.

        Raise `ValueError` if a plan names a device or a camera that does not exist.
        """
        if not self.plans:
            return
        if not self._checked:
            self.check()
            self._checked = True
        with self._lock:
            for plan in tuple(self.plans):
                since_s = plan.begins(now_s, self.opened_s, state)
                if since_s is not None:
                    self.plans.remove(plan)
                    self._begin(plan.fault, since_s)

    def _begin(self, fault: str, since_s: float) -> None:
        device, _, name = fault.partition(".")
        if device == PICTURE:
            self.pictures.panel.switch_on(name, since_s)
        else:
            self.faults.switch_on(fault)
        self.begun.append((since_s, fault))

    def _require(self, plan: FaultPlan) -> None:
        device, _, name = plan.fault.partition(".")
        if device not in self.faults:
            raise ValueError(
                f"fault {plan.fault!r}: expected DEVICE.FAULT with one of {', '.join(self.faults)}"
            )
        if device == PICTURE:
            self.pictures.panel.require_camera(name)
