"""The state of a run, a snapshot of a run, and the outcome of a run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

from dic.runfile.schema import Level, RunStatus
from drivers.interfaces import LoadFrameState, StageState
from rig.engine.timing import Timing, TimingNow
from rig.live.values import LiveNow
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import StepRecord


class State(Enum):
    """The states of the engine. The docstring of `Engine` shows the transitions between the states."""

    IDLE = "idle"
    PREPARING = "preparing"
    MOVING = "moving"
    IMAGING = "imaging"
    PAUSED = "paused"
    SAFING = "making safe"
    COMPLETED = "completed"
    ABORTED = "aborted"
    FAILED = "failed"

    @property
    def ending(self) -> bool:
        """True if the run is ending or has ended."""
        return self in (State.SAFING, State.COMPLETED, State.ABORTED, State.FAILED)


@dataclass(frozen=True)
class EngineStatus:
    """A snapshot of a run: the state, the current step, the number of steps and the latest reading.

    `simulated` is True if any device of the rig is simulated. `steps_before` is the number of steps that an
    earlier run has finished, if this run continues it; `steps_done` does not count these steps. `acquisition`
    has the numbers of images, once an acquisition has begun. `load_is_measured` is True if the load frame is
    only read, so that nothing of this program stops it. `live` is what a person sees of a phase without
    interruption, and None outside of one.
    """

    state: State
    step: ProtocolStep | None
    steps_planned: int
    steps_done: int
    reading: RigReading | None
    simulated: bool = False
    steps_before: int = 0
    acquisition: TimingNow | None = None
    load_is_measured: bool = False
    live: LiveNow | None = None

    @property
    def steps_finished(self) -> int:
        """Number of planned steps that are finished, also by an earlier run that this run continues."""
        return self.steps_before + self.steps_done


@dataclass(frozen=True)
class MeasuredAtRest:
    """The newest load, and displacement (NaN without one), of a load frame that is only read."""

    load_n: float
    displacement_mm: float = math.nan


@dataclass(frozen=True)
class AtRest:
    """The last readings of the load frame and the stage, for example after the end of a run.

    Attributes
    ----------
    load_frame : LoadFrameState or None
    stage : StageState or None
        None if the rig has no such device, or if the device did not answer.
    silent : dict of str to str
        The devices that did not answer, with the reason.
    stopped : frozenset of str
        The devices that had confirmed a hold or a stop just before.
    measured : MeasuredAtRest or None
        The values of a load frame that is only read; None without one, or if it does not answer.
    """

    load_frame: LoadFrameState | None = None
    stage: StageState | None = None
    silent: dict[str, str] = field(default_factory=dict)
    stopped: frozenset[str] = frozenset()
    measured: MeasuredAtRest | None = None


@dataclass(frozen=True)
class PauseTotals:
    """The pauses of a run: their number, their whole duration in s, and the steps that they touched.

    The images of a `late` step were taken when the run went on. Those of a `missed` step were not taken,
    because the next images of the same hold were due as well. Images of an acquisition are counted by its
    `Timing` instead.
    """

    count: int = 0
    duration_s: float = 0.0
    late_steps: int = 0
    missed_steps: int = 0


@dataclass(frozen=True)
class LogEntry:
    """One event of the engine, as in the run file. `time_s` is in seconds on the rig's clock."""

    time_s: float
    level: Level
    message: str


News: TypeAlias = EngineStatus | StepRecord | LogEntry
"""Type of the reports that a listener of `on_news` receives."""


@dataclass(frozen=True)
class Outcome:
    """The result of a run.

    Attributes
    ----------
    status, reason : str
        The status and the reason, as in the run file.
    steps_done : int
    unsafe : tuple of str
        The cause for each device whose safe state was not confirmed.
    lost_listeners : tuple of str
        One sentence for each listener that raised an exception or missed reports, although the run went on.
    lost_devices : tuple of str
        One sentence for each device in whose driver a call hangs. Such a device is not closed.
    steps : tuple of StepRecord
        The steps in the run file; of an acquisition only the newest ones.
    recorded : bool
        True if everything was written into the run file. False if the run ended because the file could not be
        written.
    at_end : AtRest
        The readings of load frame and stage after the end of the run.
    timing : Timing or None
        How well the images of all acquisitions kept their times; None without timed images.
    pauses : PauseTotals
        The pauses of the run, and the steps whose images fell into them.
    lost_samples : dict of str to int
        Number of lost samples of each channel device that has lost some.
    """

    status: RunStatus
    reason: str
    steps_done: int
    unsafe: tuple[str, ...] = ()
    lost_listeners: tuple[str, ...] = ()
    lost_devices: tuple[str, ...] = ()
    steps: tuple[StepRecord, ...] = ()
    recorded: bool = True
    at_end: AtRest = field(default_factory=AtRest)
    timing: Timing | None = None
    pauses: PauseTotals = PauseTotals()
    lost_samples: Mapping[str, int] = field(default_factory=dict)

    @property
    def shortfalls(self) -> list[str]:
        """One sentence for each kind of data that the protocol wanted and the run file lacks."""
        found = [] if self.timing is None or not self.timing.is_late else self.timing.sentences()
        if missed := self.pauses.missed_steps:
            found.append(
                f"{missed} {'step has' if missed == 1 else 'steps have'} no images, which fell into a pause "
                "of a hold"
            )
        return found + [
            f"channels.{name}: {lost} samples were lost; use a faster line, or ask for a lower rate"
            for name, lost in self.lost_samples.items()
        ]

    @property
    def is_good(self) -> bool:
        """True if the protocol was completed, no image was late, and no image or sample is missing."""
        return self.status == "completed" and not self.shortfalls
