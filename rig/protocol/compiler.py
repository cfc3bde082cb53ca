"""Compile the phases of a protocol file to a course, and collect contradictions between phases."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from rig.errors import ProtocolError
from rig.protocol import phases as tables
from rig.protocol.approach import Approach
from rig.protocol.conditions import TARE_PER_INCREMENT, Conditions, Demand, DeviceName, Pull, Turn, Zeroing
from rig.protocol.course import Beginning, Course, Part, Place
from rig.protocol.criteria import LoadDropCriterion
from rig.protocol.cycles import Cycles
from rig.protocol.durations import motion_times_s
from rig.protocol.hold import Hold
from rig.protocol.move import Ending, Move
from rig.protocol.plasticity import first_judged_n
from rig.protocol.step import UNITS, ProtocolStep, Quantity, Reading
from rig.protocol.tables import Limits, PhasesSettle, too_fine

STEPS_MAX = 50_000
_TOLERANCES: dict[Quantity, str] = {
    "load": "load_tolerance_n",
    "displacement": "displacement_tolerance_mm",
    "rotation": "angle_tolerance_deg",
}


class Compiler:
    """Compiles the phases of a protocol to a `Course`, and checks them.

    Parameters
    ----------
    phases : sequence of Phase
    settle : PhasesSettle
    limits : Limits or None
    tare_max_n : float or None

    Attributes
    ----------
    course : Course
        The compiled course. Do not use it if `mistakes` is not empty.
    mistakes : list of str
    """

    def __init__(
        self,
        phases: Sequence[tables.Phase],
        settle: PhasesSettle,
        limits: Limits | None,
        tare_max_n: float | None,
    ) -> None:
        self.mistakes: list[str] = []
        self._settle = settle
        self._limits = limits
        self._tare_max_n = tare_max_n
        self._demands: list[Demand] = []
        self._turns: list[Turn] = []
        self._increments_n: list[float] = []
        self._ranges_n: list[float] = []
        self._assured_n = 0.0
        self._elastic_n = 0.0
        self._moved: set[Quantity] = set()
        self._where = ""
        start = Place(
            load_max_n=limits.load_max_n if limits else 0.0,
            displacement_max_mm=limits.displacement_max_mm if limits else 0.0,
        )
        self._place = start
        parts: list[Part] = [Beginning()]
        for number, phase in enumerate(phases, 1):
            self._where = f"phase {number} ({phase.do})"
            part = self._compile(number, phase)
            if isinstance(part, Beginning):
                parts[0] = part
            else:
                parts.append(part)
            self._place = part.end(self._place)
        self.course = Course(tuple(parts), start)
        self._check_tables()
        self._check_size()

    @property
    def conditions(self) -> Conditions:
        """The requirements of the phases for the rig."""
        devices: set[DeviceName] = set()
        if self._moved & {"load", "displacement"}:
            devices.add("load_frame")
        if "rotation" in self._moved:
            devices.add("stage")
        zeroing = None
        limits, demands = self._limits, self._demands
        if "load_frame" in devices and limits is not None:
            demands = [
                Demand("limits.load_max_n", limits.load_max_n, "load_max_n", "N"),
                Demand("limits.displacement_max_mm", limits.displacement_max_mm, "displacement_max_mm", "mm"),
                *demands,
            ]
            zeroing = Zeroing(
                self._tare_max_n or 0.0,
                "start.tare_max_n",
                self._tolerance("load"),
                self._tolerance("displacement"),
            )
        return Conditions(
            devices=frozenset(devices),
            limits=limits if "load_frame" in devices else None,
            carried_n=self._carried_n(),
            zeroing=zeroing,
            pull=self._pull if "load_frame" in devices and limits is not None else None,
            zero_tolerance_deg=self._tolerance("rotation") if "stage" in devices else None,
            demands=tuple(demands),
            turns=tuple(self._turns),
        )

    @property
    def _pull(self) -> Pull:
        rates_n_s = [demand.value for demand in self._demands if demand.fact == "load_rate_max_n_s"]
        # Take at most a tenth of the load limit, because the specimen may not be elastic up to a higher load.
        increment_n = min([*self._increments_n, *self._ranges_n, self._carried_n()])
        return Pull(
            increment_n,
            max(rates_n_s, default=None),
            assured_n=self._assured_n,
            elastic_n=self._elastic_n,
        )

    def _compile(self, number: int, phase: tables.Phase) -> Part:
        match phase:
            case tables.Preload():
                return self._preload(number, phase)
            case tables.ToLoad():
                move = self._load(phase.load_n, phase.rate_n_s)
                self._expect_load(phase)
                approach = self._approach(move, phase.load_n, phase.images, self._ending(phase.until))
                return self._if_passed(approach, phase.if_passed)
            case tables.ToDisplacement():
                move = self._displacement(phase.displacement_mm, phase.speed_mm_s)
                approach = self._approach(
                    move, phase.displacement_mm, phase.images, self._ending(phase.until)
                )
                return self._if_passed(approach, phase.if_passed)
            case tables.Unload():
                move = self._load(phase.load_n, phase.rate_n_s)
                return self._approach(move, phase.load_n, phase.images, down=True)
            case tables.Rotate():
                return self._rotate(phase)
            case tables.Hold():
                return self._hold(phase)
            case tables.Cycles():
                return self._cycles(phase)

    def _expect_load(self, phase: tables.ToLoad) -> None:
        """Collect the load that a specimen certainly carries, and the highest load at which it is elastic."""
        assured_n, until = phase.load_n, phase.until
        if until is not None and until.plastic is not None:
            increment_n = phase.images.every_n or 0.5 * phase.load_n
            assured_n = min(phase.load_n, first_judged_n(until.plastic, increment_n))
            self._elastic_n = max(self._elastic_n, until.plastic.judged_above_n)
        elif until is not None:
            assured_n = 0.0
        self._assured_n = max(self._assured_n, assured_n)

    def _preload(self, number: int, phase: tables.Preload) -> Beginning:
        move = self._load(phase.load_n, phase.rate_n_s)
        if number > 1:
            self._mistake("only the first phase can be a preload; use to-load")
        self._assured_n = max(self._assured_n, phase.load_n)
        motion_s = move.duration_s(phase.load_n)
        return Beginning(
            ProtocolStep(
                1,
                "reference",
                phase.load_n,
                move.tolerance,
                phase.rate_n_s,
                travel=phase.load_n,
                motion_s=motion_s,
            )
        )

    def _approach(
        self,
        move: Move,
        target: float,
        images: tables.LoadImages | tables.DisplacementImages,
        ending: Ending | None = None,
        *,
        down: bool = False,
    ) -> Approach:
        span = self._place.of(move.quantity)
        unit = UNITS[move.quantity]
        beyond = target >= span.high if down else target <= span.low
        if beyond and (span.is_known or down):
            way, other = ("below", "to-load") if down else ("above", "unload")
            if move.quantity == "displacement":
                other = "unload or cycles"
            self._mistake(
                f"a target {way} {span.high if down else span.low:g} {unit}, where the phase starts, is "
                f"expected, got {target:g}; use {other} for the other direction"
            )
        increment = images.every_n if isinstance(images, tables.LoadImages) else images.every_mm
        if move.quantity == "load" and not down:
            self._increments_n.append(target if increment is None else increment)
        if increment is not None:
            key = f"{self._where}: images.every_{unit.lower()}"
            self.mistakes += too_fine(key, increment, move.tolerance)
        judged_at_readings = ending is None or ending.criterion.at_readings() is not None
        if not judged_at_readings and increment is None and images.every_s is None:
            self._mistake(
                "until.plastic needs images at increments or times, because it compares stiffnesses between "
                "images; add images.every_n or images.every_s"
            )
        return Approach(
            move,
            target,
            math.inf if increment is None else increment,
            math.inf if images.every_s is None else images.every_s,
            down,
            images=not images.never,
            ending=ending,
        )

    def _if_passed(self, approach: Approach, if_passed: tables.IfPassed) -> Approach:
        """Return an approach that knows what to do if its target has been passed already."""
        if if_passed != "fail":
            return replace(approach, goes_back=if_passed == "go-back")
        where, quantity = self._where, approach.move.quantity
        unit = UNITS[quantity]
        return replace(
            approach,
            refusal=lambda reading: ProtocolError(
                where,
                f"a {quantity} below {approach.target:g} {unit}, so that the motion pulls",
                f"{reading.of(quantity):.6g} {unit}",
                'go farther in this phase, or set if_passed = "go-on" or "go-back"',
            ),
        )

    def _rotate(self, phase: tables.Rotate) -> Approach:
        move = Move("rotation", math.nan, self._need("rotation"), is_timed=False)
        start_deg = self._place.rotation.low
        down = phase.angle_deg < start_deg
        every_deg = phase.images.every_deg
        if every_deg is not None:
            self.mistakes += too_fine(f"{self._where}: images.every_deg", every_deg, move.tolerance)
        if abs(phase.angle_deg - start_deg) <= move.tolerance:
            self._mistake(f"an angle other than {start_deg:g} deg, where the phase starts, is expected")
        lowest, highest = sorted((start_deg, phase.angle_deg))
        self._demands += [
            Demand(f"{self._where}: angle_deg", highest, "angle_max_deg", "deg"),
            Demand(f"{self._where}: angle_deg", lowest, "angle_min_deg", "deg", is_lowest=True),
        ]
        travel_deg = highest - lowest if every_deg is None else min(every_deg, highest - lowest)
        self._turns.append(Turn(f"a step of {self._where}", travel_deg))
        return Approach(move, phase.angle_deg, math.inf if every_deg is None else every_deg, down=down)

    def _hold(self, phase: tables.Hold) -> Hold:
        every_s = math.inf if phase.images.every_s is None else phase.images.every_s
        move = None
        if phase.keep == "load":
            move = Move("load", phase.rate_n_s or math.nan, self._need("load"))
            self._demand("rate_n_s", move.rate, "load_rate_max_n_s", "N/s")
        elif phase.keep == "displacement":
            move = Move("displacement", math.nan, self._need("displacement"))
        else:
            self._need("rotation")
        return Hold(move, phase.duration_s, every_s)

    def _cycles(self, phase: tables.Cycles) -> Cycles:
        low, high = phase.ends
        if phase.rate_n_s is not None:
            move = self._load(high, phase.rate_n_s)
            self._assured_n = max(self._assured_n, high)
            self._ranges_n.append(high - low)
        else:
            move = self._displacement(high, phase.speed_mm_s or math.nan)
            self._displacement(low, move.rate)
        keys = f"{self._where}: the difference of both ends"
        self.mistakes += too_fine(keys, high - low, move.tolerance)
        ending = None
        if phase.until is not None:
            ending = self._drop(phase.until.load_drop, phase.until.if_never)
        return Cycles(move, low, high, phase.count, phase.images.every_cycles, ending)

    def _load(self, load_n: float, rate_n_s: float) -> Move:
        move = Move("load", rate_n_s, self._need("load"))
        self._demand("rate_n_s", rate_n_s, "load_rate_max_n_s", "N/s")
        needed_n = load_n + move.tolerance
        if self._limits is not None and needed_n > self._limits.load_max_n:
            self._mistake(
                f"limits.load_max_n must be at least {needed_n:g} (the load and the tolerance), "
                f"got {self._limits.load_max_n:g}"
            )
        return move

    def _displacement(self, displacement_mm: float, speed_mm_s: float) -> Move:
        move = Move("displacement", speed_mm_s, self._need("displacement"))
        self._demand("speed_mm_s", speed_mm_s, "speed_max_mm_s", "mm/s")
        needed_mm = abs(displacement_mm) + move.tolerance
        if self._limits is not None and needed_mm > self._limits.displacement_max_mm:
            self._mistake(
                f"limits.displacement_max_mm must be at least {needed_mm:g} (the displacement and the "
                f"tolerance), got {self._limits.displacement_max_mm:g}"
            )
        return move

    def _ending(self, until: tables.LoadUntil | None) -> Ending | None:
        if until is None:
            return None
        if until.load_drop is not None:
            return self._drop(until.load_drop, until.if_never)
        criterion = until.criterion(self._carried_n())
        assert criterion is not None
        return Ending(criterion, self._failure(criterion.describe(), until.if_never))

    def _drop(self, fraction: float, if_never: str) -> Ending:
        limits = self._limits
        if limits is not None and fraction >= limits.break_load_drop:
            self._mistake(
                f"until.load_drop must be below limits.break_load_drop, {limits.break_load_drop:g}, which "
                f"ends the run, got {fraction:g}"
            )
        criterion = LoadDropCriterion(fraction, self._carried_n())
        return Ending(criterion, self._failure(criterion.describe(), if_never))

    def _failure(self, expected: str, if_never: str) -> Callable[[Reading], ProtocolError] | None:
        where = self._where
        if if_never == "go-on":
            return None
        return lambda reading: ProtocolError(
            f"{where}, at {reading.load_n:.0f} N and {reading.displacement_mm:.4g} mm",
            expected,
            "none",
            'check the specimen; go farther in this phase, or set until.if_never = "go-on"',
        )

    def _need(self, quantity: Quantity) -> float:
        self._moved.add(quantity)
        return self._tolerance(quantity)

    def _tolerance(self, quantity: Quantity) -> float:
        found: float | None = getattr(self._settle, _TOLERANCES[quantity])
        return 0.0 if found is None else found

    def _demand(self, key: str, value: float, fact: str, unit: str) -> None:
        self._demands.append(Demand(f"{self._where}: {key}", value, fact, unit))

    def _mistake(self, sentence: str) -> None:
        self.mistakes.append(f"{self._where}: {sentence}")

    def _carried_n(self) -> float:
        """Return the load above which a drop counts as a break. At lower loads, the grips may still seat."""
        return 0.1 * self._limits.load_max_n if self._limits is not None else 0.0

    def _increment_n(self) -> float:
        """Return the smallest load increment of all phases, or the load limit if there is no increment."""
        return min(self._increments_n, default=self._limits.load_max_n if self._limits else 0.0)

    def _check_tables(self) -> None:
        pulls = bool(self._moved & {"load", "displacement"})
        # Setting load and displacement to zero needs the tolerances of both.
        quantities: set[Quantity] = self._moved | ({"load", "displacement"} if pulls else set())
        for quantity, key in _TOLERANCES.items():
            if quantity in quantities and getattr(self._settle, key) is None:
                self.mistakes.append(f"settle.{key} is missing; add it")
        if pulls and self._limits is None:
            self.mistakes.append("limits is missing; add it, because a phase moves the load frame")
        limit_n = TARE_PER_INCREMENT * self._increment_n()
        if pulls and self._limits is not None and (self._tare_max_n or 0.0) > limit_n:
            self.mistakes.append(
                f"start.tare_max_n must be at most {limit_n:g} ({TARE_PER_INCREMENT:.0%} of the smallest "
                "increment to a load), because a load that is zeroed is missing from every later reading, "
                f"got {self._tare_max_n:g}"
            )
        if pulls and self._tare_max_n is None:
            self.mistakes.append(
                "start.tare_max_n is missing; add it, because the load frame is zeroed at the reference"
            )

    def _check_size(self) -> None:
        if self.mistakes:
            return
        count = len(self.course.steps())
        if count > STEPS_MAX:
            self.mistakes.append(
                f"phases: at most {STEPS_MAX} steps are expected, got {count}; take images less often"
            )
            return
        hours = math.fsum(time_s or 0.0 for time_s in motion_times_s(self.course.steps(), None)) / 3600.0
        if hours > tables.HOURS_MAX:
            self.mistakes.append(
                f"phases: at most {tables.HOURS_MAX} hours are expected, got {hours:.0f}; split the test"
            )
