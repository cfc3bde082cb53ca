"""Check at every reading of a motion by hand that load and displacement agree.

A motion by hand has no protocol, so nothing is known about the specimen. The bounds come from the table
[limits] of the rig file, otherwise from defaults for stiff specimens. The defaults are strict, because it
harms no specimen if a motion ends too early.
"""

import math
from dataclasses import dataclass

from rig.errors import ImplausibleReading, LimitViolation
from rig.limit_settings import RigLimits
from rig.limits.agreement import DROP_SHARE, Agreement
from rig.limits.following import Following, History
from rig.limits.stiffness import MACHINE_MIN_N_MM, SEATING_MM, SEATING_N_MM, LoadStringBounds
from rig.protocol.conditions import Pull, Zeroing
from rig.protocol.step import ProtocolStep, Quantity, RigReading

SPECIMEN_MIN_N_MM = 4_000.0
"""Default of the smallest stiffness of a specimen: a laminate of 20 GPa, 20 mm² and 100 mm."""
MACHINE_MAX_N_MM = 300_000.0
"""Default of the largest stiffness. No load frame for specimens of this kind is stiffer."""
SLACK_MM, BACKLASH_MM = 0.1, 0.02
"""Travel in mm before the load begins to change, for an unloaded specimen and for a loaded one."""
LOADED_SHARE = 0.01
"""Fraction of the largest load above which a specimen is certainly loaded."""
LOAD_TOLERANCE_SHARE, DISPLACEMENT_TOLERANCE_MM = 0.002, 0.005
"""Tolerances of load, as a fraction of the largest load, and of displacement. Five standard deviations of the
noise at rest are at most these values."""
_DISPLACEMENT_STEP_SHARE = 0.1
_SIGMAS = 8.0
_RATE_MARGIN, _STIFFNESS_MARGIN = 3.0, 5.0
_JUMP_SHARE = 0.01
_LEARNED_MM = 0.02
_REMEDY = (
    "look at the specimen, then check the load cell, its cable and the displacement transducer before "
    "anything moves again; if all are sound, set limits.specimen_stiffness_min_n_mm in the rig file for a "
    "soft specimen, or give --free if no specimen is in the grips"
)


@dataclass(frozen=True)
class HandMotion:
    """A motion that a person commands, with the range in which load and displacement must stay."""

    doing: str  # description of the motion, such as ``unload to 0 N at 140 N/s``
    quantity: Quantity  # "load", "displacement" or "rotation"
    # in N, mm or degrees
    target: float
    tolerance: float
    rate: float  # in N/s or mm/s, or NaN for an angle, whose speed the rig file determines
    duration_s: float  # planned duration
    # smallest and largest permitted reading
    load_n: tuple[float, float] = (-math.inf, math.inf)
    displacement_mm: tuple[float, float] = (-math.inf, math.inf)
    # largest load of the load frame, if load and displacement are compared. None for a motion without a
    # specimen, or of an angle.
    load_max_n: float | None = None

    @property
    def step(self) -> ProtocolStep:
        """The motion as a step of a protocol."""
        return ProtocolStep(0, self.quantity, self.target, self.tolerance, self.rate)

    def check(self, reading: RigReading) -> None:
        """Raise `LimitViolation` if the load or displacement of a reading is outside the permitted range."""
        for value, (low, high), name, unit in (
            (reading.load_n, self.load_n, "load", "N"),
            (reading.displacement_mm, self.displacement_mm, "displacement", "mm"),
        ):
            # Accept NaN, which a reading contains only without a load frame. Drivers refuse a load that is
            # NaN.
            if math.isnan(value) or low <= value <= high:
                continue
            raise LimitViolation(
                self.doing,
                f"a {name} from {low:.6g} to {high:.6g} {unit}",
                f"{value:.6g} {unit}",
                "look at the machine and the specimen; if both are sound, move in smaller steps with rig jog",
            )


def hand_string(limits: RigLimits, start_n: float = 0.0, load_max_n: float = math.inf) -> LoadStringBounds:
    """Return the bounds of specimen, grips and load frame in series, for a motion by hand.

    `limits` is the table [limits] of the rig file. `start_n` and `load_max_n` are the load before the motion
    and the largest load of the load frame.
    """
    machine_min = limits.machine_stiffness_min_n_mm or MACHINE_MIN_N_MM
    specimen_min = limits.specimen_stiffness_min_n_mm or SPECIMEN_MIN_N_MM
    is_loaded = abs(start_n) > LOADED_SHARE * load_max_n
    return LoadStringBounds(
        stiffness_min_n_mm=1.0 / (1.0 / machine_min + 1.0 / specimen_min),
        stiffness_max_n_mm=limits.machine_stiffness_max_n_mm or MACHINE_MAX_N_MM,
        seating_mm=SEATING_MM if limits.seating_mm is None else limits.seating_mm,
        seating_n_mm=limits.seating_stiffness_n_mm or SEATING_N_MM,
        slack_mm=BACKLASH_MM if is_loaded else SLACK_MM,
        flow_mm=0.0,
        relaxation=0.0,
        speed_max_mm_s=None,
        elastic_mm=math.inf,
        first_n=math.inf,
    )


def plausible_travel_mm(string: LoadStringBounds, start_n: float, target_n: float) -> tuple[float, float]:
    """Return the smallest and the largest plausible travel of the crosshead for a motion to a load.

    On the way to a higher load the grips may seat. Against the direction of the motion, only the slack is
    plausible.
    """
    change_n = abs(target_n - start_n)
    if target_n >= start_n:
        return -string.slack_mm, string.displacement_max_mm(change_n)
    return -string.slack_mm - change_n / string.stiffness_min_n_mm, string.slack_mm


def speed_of_load_mm_s(limits: RigLimits, rate_n_s: float) -> float:
    """Return the largest speed of the crosshead that a plausible specimen needs for a load rate."""
    string = hand_string(limits)
    return rate_n_s * (1.0 / string.stiffness_min_n_mm + 1.0 / string.seating_n_mm)


class HandAgreement:
    """Compares load and displacement at every reading of one motion by hand.

    `limits` is the table [limits] of the rig file. `rest` are readings of the machine at rest, the last one
    just before the motion.
    """

    def __init__(self, motion: HandMotion, limits: RigLimits, rest: list[RigReading]) -> None:
        assert motion.load_max_n is not None
        self._motion, self._to_load = motion, motion.quantity == "load"
        self._start = self._last = start = rest[-1]
        step, load_tolerance_n = motion.step, LOAD_TOLERANCE_SHARE * motion.load_max_n
        string = hand_string(limits, start.load_n, motion.load_max_n)
        self._stiffness_max_n_mm = string.stiffness_max_n_mm
        self._secant_n_mm: float | None = None
        self._outward = 1.0 if motion.target >= step.value(start) else -1.0
        self._best_n = self._outward * start.load_n
        if self._to_load:
            size_n = abs(motion.target - start.load_n)
        else:
            size_n = max(abs(start.load_n), _DISPLACEMENT_STEP_SHARE * motion.load_max_n)
        self._size_n = max(size_n, load_tolerance_n)
        pull = Pull(self._size_n, motion.rate if self._to_load else None, assured_n=self._size_n)
        zeroing = Zeroing(math.inf, "", load_tolerance_n, DISPLACEMENT_TOLERANCE_MM)
        self._agreement = Agreement(string, pull, zeroing)
        for reading in rest:
            self._agreement.check(reading, motion.doing)
        self._agreement.begin(step)
        self._following = Following(
            start,
            outward=self._outward,
            increment_n=self._size_n,
            noise_n=self._agreement.noise_n,
            noise_mm=self._agreement.noise_mm,
            history=History(stiffness_n_mm=string.stiffness_min_n_mm),
            elastic_n=0.0,
            flow_mm=string.slack_mm,
        )

    def check(self, reading: RigReading) -> None:
        """Check one reading of the motion.

        Raise `ImplausibleReading` if no correct load cell could show this load at this displacement.
        """
        try:
            self._check_jump(reading)
            self._check_direction(reading)
            self._agreement.check(reading, self._motion.doing)
            if reading.moving:
                self._following.check(reading, self._motion.doing)
        except ImplausibleReading as error:
            # Replace the remedy, because the remedy of a run names keys of its protocol.
            raise ImplausibleReading(error.step, error.expected, error.got, _REMEDY) from None
        self._last = reading

    def _check_jump(self, reading: RigReading) -> None:
        """Check that the load does not change faster than the rate of the motion explains."""
        change_n = abs(reading.load_n - self._last.load_n)
        if self._to_load:
            explained_n = _RATE_MARGIN * self._motion.rate * (reading.time_s - self._last.time_s)
            greatest_n = explained_n + self._margin_n(_JUMP_SHARE)
        else:
            travel_mm = abs(reading.displacement_mm - self._last.displacement_mm)
            explained_n = (travel_mm + _SIGMAS * self._agreement.noise_mm) * self._stiffest_n_mm()
            greatest_n = explained_n + self._margin_n(DROP_SHARE)
        if change_n > greatest_n:
            raise ImplausibleReading(
                self._motion.doing,
                f"a change of the load by {greatest_n:.4g} N at most from one reading to the next",
                f"{change_n:.4g} N: the load cell shows a wrong load, or the specimen slips or breaks",
                _REMEDY,
            )

    def _check_direction(self, reading: RigReading) -> None:
        """Check that the load does not fall while the crosshead pulls, nor rise while it moves back."""
        load_n = self._outward * reading.load_n
        self._best_n = max(self._best_n, load_n)
        least_n = self._best_n - self._margin_n(DROP_SHARE)
        if load_n < least_n:
            rises, side = ("rises", "above") if self._outward > 0.0 else ("falls", "below")
            bound_n = self._outward * least_n
            raise ImplausibleReading(
                self._motion.doing,
                f"a load that {rises} during this motion, {side} {bound_n:.4g} N",
                f"{reading.load_n:.4g} N: the load cell shows a wrong load, or the specimen slips or breaks",
                _REMEDY,
            )

    def _stiffest_n_mm(self) -> float:
        """Return the largest plausible stiffness, from what this motion has shown so far."""
        travel_mm = abs(self._last.displacement_mm - self._start.displacement_mm)
        if travel_mm > _LEARNED_MM:
            secant_n_mm = abs(self._last.load_n - self._start.load_n) / travel_mm
            self._secant_n_mm = max(self._secant_n_mm or 0.0, secant_n_mm)
        if self._secant_n_mm is None:
            return self._stiffness_max_n_mm
        return min(self._stiffness_max_n_mm, _STIFFNESS_MARGIN * self._secant_n_mm)

    def _margin_n(self, share: float) -> float:
        return share * self._size_n + _SIGMAS * self._agreement.noise_n
