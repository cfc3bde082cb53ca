"""The phases of a protocol file, and the draft of the course to which each phase adds its part."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field

from drivers.settings import Settings
from rig.errors import ProtocolError
from rig.protocol.conditions import (
    TARE_PER_INCREMENT,
    Conditions,
    Demand,
    DeviceName,
    Pull,
    StageTurn,
    Zeroing,
)
from rig.protocol.course import Beginning, Course, CoursePart, Positions
from rig.protocol.criteria import Criterion, LoadDropCriterion
from rig.protocol.durations import motion_times_s
from rig.protocol.move import Ending, Move
from rig.protocol.step import ProtocolStep, Quantity, RigReading
from rig.protocol.tables import Limits, PhasesSettle, too_fine

STEPS_MAX = 50_000
HOURS_MAX = 30 * 24
Positive: TypeAlias = Annotated[float, Field(gt=0.0)]


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("a value above 0 (tension) or below 0 (compression) is expected")
    return value


Signed: TypeAlias = Annotated[float, AfterValidator(_not_zero)]
"""A load or a displacement: positive in tension, negative in compression."""
Increment: TypeAlias = Annotated[
    float | None, Field(gt=0.0, description="increment after which the motion stops and settles")
]
IfNever: TypeAlias = Literal["fail", "go-on"]
"""What happens if the event that should end a phase never happens."""
_TOLERANCES: dict[Quantity, str] = {
    "load": "load_tolerance_n",
    "displacement": "displacement_tolerance_mm",
    "rotation": "angle_tolerance_deg",
}
_LIMITS: dict[Quantity, tuple[str, str]] = {
    "load": ("load_max_n", "load_min_n"),
    "displacement": ("displacement_max_mm", "displacement_min_mm"),
}
_RATES: dict[Quantity, tuple[str, str, str]] = {
    "load": ("rate_n_s", "load_rate_max_n_s", "N/s"),
    "displacement": ("speed_mm_s", "speed_max_mm_s", "mm/s"),
}


class Phase(Settings, ABC):
    """A table `[[phases]]` of a protocol file. `do` names the kind of the phase.

    A kind of phase is one module in `rig.protocol.phases`: the keys, their checks, and the compilation.
    """

    do: str

    @abstractmethod
    def compile(self, draft: "Draft") -> None:
        """Add the part of the course, the demands on the rig and the mistakes of this phase to a draft."""


class Draft:
    """The course of a protocol while its phases are compiled.

    Attributes
    ----------
    mistakes : list of str
        Do not use the course if there are any.
    number : int
        Number of the phase that is compiled, from 1.
    where : str
        This phase, for messages.
    place : Positions
        The possible positions of the devices before this phase.
    increments_n, ranges_n : list of float
        Increments to a load, and the differences of both ends of cycles.
    turns : list of StageTurn
    gauges : set of str
        The live gauges that phases need.
    signals : set of str
        The measured channels that phases need.
    strain_rates : list of str
        The phases in which a strain rate changes the speed of a motion.
    area_mm2 : float
        Cross section of the specimen.
    """

    def __init__(
        self,
        phases: Sequence[Phase],
        settle: PhasesSettle,
        limits: Limits | None,
        tare_max_n: float | None,
        beginning: Beginning,
        area_mm2: float,
    ) -> None:
        self.mistakes: list[str] = []
        self.number = 0
        self.where = ""
        self.place = self._start = Positions.within(limits)
        self.increments_n: list[float] = []
        self.ranges_n: list[float] = []
        self.turns: list[StageTurn] = []
        self.gauges: set[str] = set()
        self.signals: set[str] = set()
        self.strain_rates: list[str] = []
        self.area_mm2 = area_mm2
        self._settle = settle
        self._limits = limits
        self._tare_max_n = tare_max_n
        self._beginning = beginning
        self._parts: list[CoursePart] = [beginning]
        self._demands: list[Demand] = []
        self._assured_n = self._elastic_n = 0.0
        self._sense = 0.0
        self._moved: set[Quantity] = set()
        for phase in phases:
            self.number += 1
            self.where = f"phase {self.number} ({phase.do})"
            phase.compile(self)
        self._check_tables()
        self._check_size()

    @property
    def course(self) -> Course:
        """The compiled course."""
        return Course(tuple(self._parts), self._start)

    def carried_n(self, sense: float) -> float:
        """Return the load above which a drop counts as a break, in tension (`sense` 1) or compression (-1).

        At lower loads, the grips may still seat.
        """
        return self._limits.carried_n(sense) if self._limits is not None else 0.0

    @property
    def conditions(self) -> Conditions:
        """The requirements of the phases for the rig."""
        devices: set[DeviceName] = {"load_frame"} if self._pulls else set()
        if "rotation" in self._moved:
            devices.add("stage")
        limits = self._limits if self._pulls else None
        return Conditions(
            devices=frozenset(devices),
            limits=limits,
            carried_n=self.carried_n(1.0),
            zeroing=None
            if limits is None
            else Zeroing(
                self._tare_max_n or 0.0,
                "start.tare_max_n",
                self._tolerance("load"),
                self._tolerance("displacement"),
            ),
            pull=None if limits is None else self._pull,
            zero_tolerance_deg=self._tolerance("rotation") if "stage" in devices else None,
            demands=(*Demand.of_limits(limits), *self._demands),
            turns=tuple(self.turns),
            signals=frozenset(self.signals),
            strain_rates=tuple(self.strain_rates),
        )

    def add(self, part: CoursePart) -> None:
        """Append the part of a phase to the course."""
        self._parts.append(part)
        self.place = part.end(self.place)

    def begin(self, reference: ProtocolStep) -> None:
        """Let the course begin with this step of the reference images."""
        self._beginning = replace(self._beginning, reference=reference)
        self._parts[0] = self._beginning
        self.place = self._beginning.end(self.place)

    def mistake(self, sentence: str) -> None:
        """Note a mistake of the present phase."""
        self.mistakes.append(f"{self.where}: {sentence}")

    def check_increment(self, key: str, increment: float, move: Move) -> None:
        """Note a mistake if an increment is so small that it could count as reached before its motion."""
        self.mistakes += too_fine(f"{self.where}: {key}", increment, move.tolerance)

    def demand(self, key: str, value: float, fact: str, unit: str, *, is_lowest: bool = False) -> None:
        """Note a value that the rig's limits must allow. The arguments are described for `Demand`."""
        demand = Demand(f"{self.where}: {key}", value, fact, unit, is_lowest)
        if demand not in self._demands:
            self._demands.append(demand)

    def expect(self, assured_n: float, elastic_n: float = 0.0) -> None:
        """Note a load that the specimen certainly carries, and one at which it is still elastic."""
        self._assured_n = max(self._assured_n, assured_n)
        self._elastic_n = max(self._elastic_n, elastic_n)

    def move(self, quantity: Quantity, rate: float = math.nan, *, is_timed: bool = True) -> Move:
        """Return a motion or a hold of a quantity, and note that the rig needs its device and its rate."""
        self._moved.add(quantity)
        if not math.isnan(rate):
            key, fact, unit = _RATES[quantity]
            self.demand(key, rate, fact, unit)
        return Move(quantity, rate, self._tolerance(quantity), is_timed)

    def move_to(self, quantity: Quantity, target: float, rate: float) -> Move:
        """Return a motion to a load or a displacement. Check the protocol's limits."""
        move = self.move(quantity, rate)
        if target != 0.0:
            self._sense = self._sense or math.copysign(1.0, target)
        limits, (most, least) = self._limits, _LIMITS[quantity]
        if limits is None:
            return move
        if target < 0.0 and (bound := getattr(limits, least)) is not None:
            if target - move.tolerance < bound:
                self.mistake(
                    f"limits.{least} must be at most {target - move.tolerance:g} (the {quantity} and the "
                    f"tolerance), got {bound:g}"
                )
        elif (needed := abs(target) + move.tolerance) > (bound := getattr(limits, most)):
            self.mistake(
                f"limits.{most} must be at least {needed:g} (the {quantity} and the tolerance), got {bound:g}"
            )
        return move

    def may_push(self, quantity: Quantity) -> bool:
        """Return True if the protocol declares a limit of compression for a load or a displacement."""
        return self._limits is not None and getattr(self._limits, _LIMITS[quantity][1]) is not None

    def push(self, quantity: Quantity, target: float) -> None:
        """Note a mistake if a target is in compression and the protocol declares no limit of compression.

        So a sign that was mistyped moves no machine the wrong way.
        """
        if target < 0.0 and self._limits is not None and not self.may_push(quantity):
            self.mistake(
                f"limits.{_LIMITS[quantity][1]} is missing; add it, because a {quantity} of {target:g} is in "
                "compression"
            )

    def ending(self, criterion: Criterion, if_never: IfNever) -> Ending:
        """Return the event that ends the present phase."""
        if if_never == "go-on":
            return Ending(criterion)
        where = self.where

        def failure(reading: RigReading) -> ProtocolError:
            return ProtocolError(
                f"{where}, at {reading.load_n:.0f} N and {reading.displacement_mm:.4g} mm",
                criterion.describe(),
                "none",
                'check the specimen; go farther in this phase, or set until.if_never = "go-on"',
            )

        return Ending(criterion, failure)

    def load_drop(self, fraction: float, if_never: IfNever, sense: float) -> Ending:
        """Return a drop of the load as the event that ends the present phase, as described for `drop`."""
        return self.ending(self.drop(fraction, sense), if_never)

    def drop(self, fraction: float, sense: float) -> LoadDropCriterion:
        """Return the criterion that the load has dropped by a fraction, and note its mistakes.

        `sense` is 1 if the load is highest in tension, and -1 if it is in compression.
        """
        limits = self._limits
        if limits is not None and fraction >= (drop := limits.drop(sense)):
            key = "break" if drop == limits.break_load_drop else "buckling"
            self.mistake(
                f"until.load_drop must be below limits.{key}_load_drop, {drop:g}, which ends the run, got "
                f"{fraction:g}"
            )
        return LoadDropCriterion(fraction, self.carried_n(sense), sense)

    @property
    def _pulls(self) -> bool:
        return bool(self._moved & {"load", "displacement"})

    @property
    def _pull(self) -> Pull:
        rates_n_s = [demand.value for demand in self._demands if demand.fact == "load_rate_max_n_s"]
        return Pull(
            # Take at most a tenth of the load limit, because the specimen may not be elastic up to a higher
            # load.
            min([*self.increments_n, *self.ranges_n, self.carried_n(self._sense or 1.0)]),
            max(rates_n_s, default=None),
            assured_n=self._assured_n,
            elastic_n=self._elastic_n,
            sense=self._sense or 1.0,
        )

    def _tolerance(self, quantity: Quantity) -> float:
        return getattr(self._settle, _TOLERANCES[quantity]) or 0.0

    def _check_tables(self) -> None:
        limits, tare_max_n = self._limits, self._tare_max_n
        # Setting load and displacement to zero needs the tolerances of both.
        quantities = self._moved | ({"load", "displacement"} if self._pulls else set())
        for quantity, key in _TOLERANCES.items():
            if quantity in quantities and getattr(self._settle, key) is None:
                self.mistakes.append(f"settle.{key} is missing; add it")
        if not self._pulls:
            return
        if limits is None:
            self.mistakes.append("limits is missing; add it, because a phase moves the load frame")
        else:
            largest_n = -limits.load_least_n if self._sense < 0.0 else limits.load_max_n
            limit_n = TARE_PER_INCREMENT * min(self.increments_n, default=largest_n)
            if (tare_max_n or 0.0) > limit_n:
                self.mistakes.append(
                    f"start.tare_max_n must be at most {limit_n:g} ({TARE_PER_INCREMENT:.0%} of the smallest "
                    "increment to a load), because a load that is zeroed is missing from every later "
                    f"reading, got {tare_max_n:g}"
                )
        if tare_max_n is None:
            self.mistakes.append(
                "start.tare_max_n is missing; add it, because the load frame is zeroed at the reference"
            )

    def _check_size(self) -> None:
        if self.mistakes:
            return
        steps = self.course.steps()
        if len(steps) > STEPS_MAX:
            self.mistakes.append(
                f"phases: at most {STEPS_MAX} steps are expected, got {len(steps)}; take images less often"
            )
            return
        hours = math.fsum(time_s or 0.0 for time_s in motion_times_s(steps, None)) / 3600.0
        if hours > HOURS_MAX:
            self.mistakes.append(
                f"phases: at most {HOURS_MAX} hours are expected, got {hours:.0f}; split the test"
            )
