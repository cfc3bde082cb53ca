"""The stages of a motion without interruption: what each commands, and what ends it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rig.protocol.acquisition_tables import Level
from rig.protocol.criteria import LoadDropCriterion
from rig.protocol.step import PhaseEvent, RigReading

_LONGER = 3.0
"""A motion may take this many times its planned time."""


@dataclass(frozen=True)
class SpeedBounds:
    """What a control of the strain rate may do with the crosshead: speeds in mm/s, acceleration in mm/s²."""

    least_mm_s: float
    greatest_mm_s: float
    acceleration_mm_s2: float


@dataclass(frozen=True)
class StrainRate:
    """A strain rate that is kept by a live gauge.

    Attributes
    ----------
    rate_s : float
        Strain rate in 1/s.
    gauge : str
        Name of the live gauge.
    parallel_length_mm : float
        Parallel length of the specimen. Where the gauge does not show the strain rate of the whole length, as
        during discontinuous yielding, the speed is the product of both (ISO 6892-1, method A2).
    bounds : SpeedBounds
    yield_drop : float
        A fall of the load by this fraction of the highest one is discontinuous yielding.
    return_s : float
        A gauge that is not valid holds the machine; for this time in s it may become valid again.
    """

    rate_s: float
    gauge: str
    parallel_length_mm: float
    bounds: SpeedBounds
    yield_drop: float
    return_s: float

    @property
    def crosshead_mm_s(self) -> float:
        """Speed of the crosshead that gives this strain rate in a specimen that takes up all the motion."""
        return self.rate_s * self.parallel_length_mm


@dataclass(frozen=True)
class StageEnds:
    """What ends a stage, whichever happens first. NaN and None for what does not.

    `sense` is 1 in tension and -1 in compression, where loads, displacements and strains are negative.
    `reaches` are levels of signals, among them those of strain.
    """

    sense: float = 1.0
    load_n: float = math.nan
    displacement_mm: float = math.nan
    duration_s: float = math.nan
    reaches: tuple[Level, ...] = ()
    load_drop: LoadDropCriterion | None = None

    @property
    def gauges(self) -> set[str]:
        """The gauges whose strain ends the stage."""
        return {level.gauge for level in self.reaches if level.gauge}

    def watch(self, begun_s: float) -> "StageWatch":
        """Return what looks for the ends of a stage that began at a time on the rig's clock."""
        return StageWatch(self, begun_s)

    def __str__(self) -> str:
        ends = [
            "" if math.isnan(self.load_n) else f"{self.load_n:g} N",
            "" if math.isnan(self.displacement_mm) else f"{self.displacement_mm:g} mm",
            "" if math.isnan(self.duration_s) else f"{self.duration_s:g} s",
            *map(str, self.reaches),
            "" if self.load_drop is None else f"a fall of the load by {self.load_drop.fraction:.0%}",
        ]
        return " or ".join(filter(None, ends)) or "the target"


class StageWatch:
    """Looks in every reading for the end of a stage. `met` is what has happened, or an empty text."""

    def __init__(self, ends: StageEnds, begun_s: float) -> None:
        self.met = ""
        self._ends, self._begun_s = ends, begun_s
        self._drop: PhaseEvent | None = None if ends.load_drop is None else ends.load_drop.at_readings()

    def see(self, reading: RigReading) -> None:
        """Look at a reading."""
        self.met = self.met or self._found(reading)

    def renew(self, paused_s: float) -> None:
        """Go on after a pause of `paused_s`, in which the load has changed."""
        self._begun_s += paused_s
        if self._drop is not None:
            self._drop.renew()

    def _found(self, reading: RigReading) -> str:
        ends = self._ends
        if self._drop is not None and self._drop(reading):
            return f"the load fell to {reading.load_n:.6g} N"
        if ends.sense * (reading.load_n - ends.load_n) >= 0.0:
            return f"{ends.load_n:g} N were reached"
        if ends.sense * (reading.displacement_mm - ends.displacement_mm) >= 0.0:
            return f"{ends.displacement_mm:g} mm were reached"
        for level in ends.reaches:
            if level.is_met(reading):
                return f"{level} was reached"
        return f"{ends.duration_s:g} s are over" if reading.time_s - self._begun_s >= ends.duration_s else ""


@dataclass(frozen=True)
class PullStage:
    """One stage: a speed of the crosshead, a rate of the load, or a strain rate, until something ends it.

    Attributes
    ----------
    speed_mm_s : float
        Speed of the crosshead, under a strain rate at its beginning; NaN for a rate of the load.
    rate_n_s, load_n : float
        Rate of the load, and the load to which the machine goes; NaN otherwise.
    strain_rate : StrainRate or None
    ends : StageEnds
    text : str
        The stage in words.
    """

    speed_mm_s: float
    ends: StageEnds
    text: str
    rate_n_s: float = math.nan
    load_n: float = math.nan
    strain_rate: StrainRate | None = None

    @property
    def is_of_load(self) -> bool:
        """True if the machine controls the load."""
        return not math.isnan(self.rate_n_s)

    @property
    def greatest_mm_s(self) -> float:
        """The greatest speed that the stage may command; NaN for a rate of the load."""
        return self.speed_mm_s if self.strain_rate is None else self.strain_rate.bounds.greatest_mm_s

    @property
    def gauges(self) -> set[str]:
        """The gauges that the stage cannot do without."""
        return self.ends.gauges | (set() if self.strain_rate is None else {self.strain_rate.gauge})


@dataclass(frozen=True)
class PullPlan:
    """A motion without interruption to a displacement, in stages.

    Attributes
    ----------
    where : str
        The phase, for messages.
    displacement_mm : float
        The farthest displacement, the target of the motion; negative in compression.
    tolerance_mm : float
        Its settle tolerance.
    stages : sequence of PullStage
    fails_at_target : bool
        True if the run ends when the displacement is reached before the last stage has ended.
    planned_s : float
        The time in s in which the slowest stage alone would reach the displacement, and the loads of others.
    """

    where: str
    displacement_mm: float
    tolerance_mm: float
    stages: Sequence[PullStage] = field(default_factory=tuple)
    fails_at_target: bool = False
    planned_s: float = math.nan

    @property
    def longest_s(self) -> float:
        """The motion must end within this time in s."""
        return _LONGER * self.planned_s

    @property
    def gauges(self) -> set[str]:
        """The gauges that the motion cannot do without."""
        return set().union(*(stage.gauges for stage in self.stages))

    @property
    def signals(self) -> set[str]:
        """The measured channels whose levels end stages."""
        levels = [level for stage in self.stages for level in stage.ends.reaches]
        return {level.signal for level in levels if level.is_of_channel}

    def __str__(self) -> str:
        return "; ".join(f"{stage.text} until {stage.ends}" for stage in self.stages)
