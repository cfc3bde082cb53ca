"""What the parts of the engine share during one run: devices, limits, run file, news and readings."""

from collections.abc import Callable
from typing import TypeVar

from dic.runfile.schema import Level
from rig.channels.run_channels import RunChannels
from rig.devices import Rig
from rig.engine.announcements import Announcements
from rig.engine.calls import Call, Calls
from rig.engine.devices import OnQuestion, called
from rig.engine.live_gauges import LiveGauges
from rig.engine.monitor import MeasuredChannels, Monitor
from rig.engine.pausing import Pauses
from rig.engine.pulses import Pulses
from rig.engine.watch import Watch
from rig.errors import Aborted
from rig.limits.run_limits import limits_on
from rig.protocol.protocol import Protocol, live_table_of
from rig.protocol.step import PhaseEvent, RigReading
from rig.protocol.tables import Settle
from rig.recorder import Recorder
from rig.recorder.records import PHASE_ENDED
from rig.samples import SignalReading

T = TypeVar("T")


class RunContext:
    """The context of one run. The engine makes it once, and each part of the engine receives it.

    Attributes
    ----------
    protocol, rig, recorder, clock, calls, devices, pulses, channels, monitor
        The parts of the run.
    news : Announcements
        What the listeners are told.
    settle : Settle
        The times for settling, and the time between two readings.
    watch : Watch
        The limits of the run.
    live : LiveGauges
        The live gauges, if the protocol declares some.
    pauses : Pauses
        Lets the engine wait while the run is paused.
    may_move : bool
        True if a device may be moving. At the beginning of a run, a device may still be moving for an earlier
        program that was killed.
    event : PhaseEvent or None
        The event that ends the present phase, as described for `ProtocolStep`.
    phase_ended : bool
        True if this event has happened during the present step.
    observers : list of callable
        Functions that are called with every reading, whichever wait has taken it. A reading has the samples
        of the channels since the one before, so who looks for an event of a channel must see all readings.
    abort_reason : str or None
        The reason for which the end of the run was requested.
    """

    def __init__(
        self,
        protocol: Protocol,
        rig: Rig,
        recorder: Recorder,
        news: Announcements,
        on_progress: Callable[[bool], None],
        on_question: OnQuestion,
    ) -> None:
        self.protocol, self.rig, self.recorder, self.news = protocol, rig, recorder, news
        self.clock = rig.clock
        self.settle: Settle = protocol.settle
        self.watch = Watch(protocol, limits_on(protocol, rig))
        self.calls = Calls(
            rig.clock, self.check_abort, rig.lost, meanwhile=self.read, every_s=self.settle.poll_s
        )
        self.devices = called(rig, self.calls, on_question)
        self.pulses = Pulses(rig, self.calls)
        self.channels = RunChannels(rig.channels, rig.clock, recorder.samples)
        sample = protocol.sample
        area_mm2 = sample.thickness_mm * sample.width_mm
        table = live_table_of(protocol)
        self.live = LiveGauges(table, rig.clock, area_mm2, recorder.samples)
        measured = MeasuredChannels(self._read_signals, rig.measured)
        self.monitor = Monitor(self.devices, self.calls, rig.clock, recorder, self.watch, measured)
        self.pauses = Pauses(self)
        self.may_move = True
        self.event: PhaseEvent | None = None
        self.phase_ended = False
        self.observers: list[Callable[[RigReading], None]] = []
        self.abort_reason: str | None = None
        self._on_progress = on_progress

    @property
    def place(self) -> str:
        """The name of the present step, for messages."""
        return str(self.news.status.step)

    def read(self) -> RigReading:
        """Read all devices except the cameras, check the limits, and tell the listeners.

        If the event of the present phase happens, hold the load frame. Every wait of the engine calls this
        method, also a wait for a camera, the operator or the disk.
        """
        self.check_abort()
        reading = self.monitor.read(self.place)
        for observe in self.observers:
            observe(reading)
        self.live.draw(reading)
        for sentence in self.channels.new_losses():
            self.log("warning", sentence)
        self.news.publish(reading=reading)
        if not self.phase_ended and self.event is not None and self.event(reading):
            self.phase_ended = True
            self.devices.hold()
            step = self.news.status.step
            number = "" if step is None else step.index
            self.log("info", f"{PHASE_ENDED} {number}: the load is {reading.load_n:.6g} N")
        self._on_progress(self.may_move or reading.moving)
        self.check_abort()
        return reading

    def _read_signals(self) -> dict[str, SignalReading]:
        return self.channels.read() | self.live.read()

    def finish(self, call: Call[T]) -> T:
        """Wait for the end of a call that may take long, and read the devices meanwhile."""
        return self.calls.finish(call, watched=True)

    def log(self, level: Level, message: str) -> None:
        """Record an event and tell the listeners."""
        self.news.event(level, message)

    def mark(self, message: str) -> None:
        """Record an event at the end of a wait, so that a replay can count the readings during the wait."""
        self.recorder.event(self.clock.now_s(), "info", "engine", message)

    def check_abort(self) -> None:
        """Raise `Aborted` if the end of the run was requested."""
        if self.abort_reason is not None:
            raise self.aborted()

    def aborted(self) -> Aborted:
        """Return the error that ends a run whose end was requested."""
        return Aborted(
            str(self.news.status.step or "before the first step"),
            "the run to go on",
            str(self.abort_reason),
            "the finished steps are on file",
        )
