"""Pause a run: the machine is held and no image is taken, until somebody lets the run go on.

Limits, interlocks and the load are watched as always. An abort ends a pause at once.
"""

import math
from dataclasses import replace
from threading import Lock
from typing import Any, Protocol

from dic.runfile.schema import Level
from rig.engine.announcements import Announcements
from rig.engine.calls import Calls
from rig.engine.devices import Devices
from rig.engine.status import PauseTotals, State
from rig.engine.watch import Watch
from rig.errors import SettleTimeout
from rig.protocol.step import PhaseEvent, ProtocolStep, RigReading
from rig.protocol.tables import Settle
from rig.recorder.records import GOES_ON, PAUSED, STEP_MISSED


class PausedRun(Protocol):
    """Interface of what is paused: the part of `rig.engine.context.RunContext` that a pause needs."""

    news: Announcements
    devices: Devices
    watch: Watch
    calls: Calls
    settle: Settle
    event: PhaseEvent | None
    may_move: bool

    @property
    def place(self) -> str:
        """The name of the present step, for messages."""

    def read(self) -> RigReading:
        """Read all devices except the cameras, and check the limits."""

    def log(self, level: Level, message: str) -> None:
        """Record an event and tell the listeners."""

    def check_abort(self) -> None:
        """Raise `Aborted` if the end of the run was requested."""


class PauseRequests(Protocol):
    """Interface of what tells the engine when to pause: people and programs, or the record of a run."""

    def asked(self, step: int, place: str) -> str:
        """Return who asks for a pause at this place of a step, or an empty text."""

    def take_over(self) -> str:
        """Return who lets the run go on, which ends the pause, or an empty text while it lasts."""


class PauseSwitch:
    """Requests of people and programs to pause a run and to go on. Any thread may call the methods."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._asked = self._over = ""
        self._at_machine = False

    @property
    def on(self) -> bool:
        """True from the request of a pause until the run goes on."""
        return bool(self._asked)

    def pause(self, who: str, *, at_machine: bool = False) -> None:
        """Request a pause. During a pause, take back a request to go on that the engine has not seen.

        A person `at_machine` may reach into the rig, so only such a person ends this pause.
        """
        with self._lock:
            self._asked, self._over = self._asked or who, ""
            self._at_machine = self._at_machine or at_machine

    def go_on(self, who: str, *, at_machine: bool = False) -> str:
        """Request that the run goes on. Return why the request is refused, or an empty text."""
        with self._lock:
            if not self._asked:
                return "the run is not paused"
            if self._at_machine and not at_machine:
                return "the run was paused at its terminal; only the person there can let it go on"
            self._over = who
            return ""

    def asked(self, _: int, __: str) -> str:
        """Return who asked for a pause, or an empty text.

        A pause whose end was requested before the engine saw it counts too: the machine was stopped, and its
        motion must be commanded again.
        """
        return self._asked

    def take_over(self) -> str:
        """Return who lets the run go on, and forget both requests; return an empty text while nobody does."""
        with self._lock:
            over = self._over
            if over:
                self._asked = self._over = ""
                self._at_machine = False
            return over


class Pauses:
    """Lets the engine wait while a run is paused.

    Attributes
    ----------
    requests : PauseRequests
        What tells when to pause. A replay sets its own.
    ended_s : float
        Time of the last reading before the run went on, in s; -inf before the first pause. The engine decides
        with times of readings, so that a replay makes the same decisions.
    totals : PauseTotals
    """

    def __init__(self, run: PausedRun) -> None:
        self.switch = PauseSwitch()
        self.requests: PauseRequests = self.switch
        self.ended_s = -math.inf
        self.totals = PauseTotals()
        self._run = run
        self._begun: RigReading | None = None
        self._before: tuple[State, PhaseEvent | None] = State.IDLE, None

    def asked(self, place: str) -> bool:
        """Return whether `point` would wait at this place of the present step."""
        return bool(self.requests.asked(self._number, place))

    def point(self, place: str) -> float | None:
        """Wait here while the run is paused, and return the duration of the pause in s.

        Return None at once if no pause was requested. The caller commands the interrupted motion again.
        `place` says where in its step the engine is. The engine calls this method where a pause may begin:
        before a motion and while it waits for one, but not in the middle of an image.
        """
        run = self._run
        run.check_abort()
        who = self.requests.asked(self._number, place)
        if not who:
            return None
        self._begin(place, who)
        return self._end(*self._wait())

    def meanwhile(self, place: str) -> bool:
        """Return True as long as the run is paused, without waiting.

        For a caller that goes on meanwhile, because it moves nothing and only lets its images wait. It calls
        this method after each reading.
        """
        run = self._run
        if self._begun is None:
            if who := self.requests.asked(self._number, place):
                self._begin(place, who)
        elif (by := self.requests.take_over()) and (reading := run.news.status.reading) is not None:
            self._end(reading, by)
        return self._begun is not None

    def _begin(self, place: str, who: str) -> None:
        """Stop everything, and begin to watch it as in a hold."""
        run = self._run
        self._before, run.event = (run.news.status.state, run.event), None
        run.log("info", f"{PAUSED} {self._number} ({place}) by {who}")
        self._begun = run.news.status.reading or run.read()
        run.devices.stop()
        step = ProtocolStep(self._number, "rest", load_drop="slow")
        run.watch.begin(step)
        run.watch.expect(step.load_drop)
        run.news.publish(state=State.PAUSED)
        self._count(count=1)

    def _end(self, reading: RigReading, by: str) -> float:
        """Let the run go on after the last reading of a pause, and return the duration of the pause in s."""
        run, (state, event) = self._run, self._before
        assert self._begun is not None
        paused_s = reading.time_s - self._begun.time_s
        self.ended_s, self._begun = reading.time_s, None
        self._count(duration_s=paused_s)
        run.log("info", f"{GOES_ON} by {by} after {paused_s:.1f} s")
        run.news.publish(state=state)
        run.event = event
        if event is not None:
            event.renew()
        return paused_s

    def late(self, step: ProtocolStep, by_s: float) -> None:
        """Record that the images of a step are taken late."""
        self._count(late_steps=1)
        self._run.log("warning", f"{step}: its images come {by_s:.1f} s late, because the run was paused")

    def missed(self, step: ProtocolStep) -> None:
        """Record that the images of a step are not taken."""
        self._count(missed_steps=1)
        self._run.log(
            "warning", f"{STEP_MISSED} {step.index}: its images and the next ones fell into a pause"
        )

    @property
    def _number(self) -> int:
        step = self._run.news.status.step
        return -1 if step is None else step.index

    def _wait(self) -> tuple[RigReading, str]:
        """Read the devices until the run goes on. Return the last reading, and who lets the run go on."""
        run = self._run
        reading = run.read()
        first_s = reading.time_s
        while not (by := self.requests.take_over()):
            if reading.moving and reading.time_s - first_s > run.settle.timeout_s:
                raise SettleTimeout(
                    f"{run.place}, paused",
                    "standstill",
                    f"a motion {run.settle.timeout_s:g} s after the stop",
                    "look at the machine, and use the emergency stop if it moves",
                )
            run.calls.pause(run.settle.poll_s)
            reading = run.read()
        run.may_move = reading.moving
        return reading, by

    def _count(self, **more: Any) -> None:
        now = vars(self.totals)
        self.totals = replace(self.totals, **{name: now[name] + added for name, added in more.items()})
