"""Tell the listeners of a run what happens, and write its events into the run file."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from dic.runfile.schema import Level
from drivers.clock import Clock, SystemClock
from rig.engine.listeners import Listeners
from rig.engine.status import LogEntry, News, Status
from rig.errors import RigError
from rig.recorder import Recorder, StepRecord


class Announcements:
    """Tells the listeners of a run every status, step and event.

    Parameters
    ----------
    recorder : Recorder
    clock : Clock
    status : Status
        The status before the run.
    on_status, on_step, on_news : iterable of callable
        The listeners, as described for `Engine`.
    end_run : callable
        Called with a reason if a listener requests the end of the run.

    Attributes
    ----------
    status : Status
        The latest snapshot of the run. Any thread may read this attribute.
    lost : list of str
        One sentence for each listener that failed or missed reports.
    """

    def __init__(
        self,
        recorder: Recorder,
        clock: Clock,
        status: Status,
        on_status: Iterable[Callable[[Status], None]],
        on_step: Iterable[Callable[[StepRecord], None]],
        on_news: Iterable[Callable[[News], None]],
        end_run: Callable[[str], None],
    ) -> None:
        self.status = status
        self.lost: list[str] = []
        self._recorder = recorder
        self._clock = clock
        self._on_status = Listeners(on_status, end_run)
        self._on_step = Listeners(on_step, end_run)
        self._on_news = Listeners[News](on_news, end_run)

    def publish(self, **changes: Any) -> None:
        """Change the status, and tell it."""
        self.status = replace(self.status, **changes)
        self._note(self._on_status.tell(self.status) + self._on_news.tell(self.status))

    def step(self, record: StepRecord) -> None:
        """Tell that a step is in the run file."""
        self.publish(steps_done=self.status.steps_done + 1)
        self._note(self._on_step.tell(record) + self._on_news.tell(record))

    def event(self, level: Level, message: str) -> None:
        """Record an event and tell it."""
        entry = LogEntry(self._clock.now_s(), level, message)
        self._recorder.event(entry.time_s, level, "engine", message)
        self._note(self._on_news.tell(entry))

    def close(self, leaving_s: float) -> None:
        """Let the listeners handle the waiting reports, all together within a real time in s."""
        end_s = SystemClock().now_s() + leaving_s
        listeners = (self._on_status, self._on_step, self._on_news)
        self._note([sentence for each in listeners for sentence in each.close(end_s)])

    def _note(self, listeners: list[str]) -> None:
        self.lost += listeners
        for listener in listeners:
            try:
                self.event("warning", listener)
            except RigError:
                # At the end of a run the run file may be closed or broken, so the event may not be written.
                if not self.status.state.ending:
                    raise
