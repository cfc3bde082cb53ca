"""Tell the listeners of a run what happens, and write its events into the run file."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from dic.runfile.schema import Level
from drivers.clock import Clock, SystemClock
from rig.engine.listeners import Listener
from rig.engine.status import EngineStatus, LogEntry, News
from rig.errors import RigError
from rig.recorder import Recorder, StepRecord


class Announcements:
    """Tells the listeners of a run every status, step and event.

    The listeners are described for `Engine`. `end_run` is called with a reason if one of them requests the
    end of the run.

    `status` is the latest snapshot of the run. Any thread may read this attribute. `lost` has one sentence
    for each listener that failed or missed reports.
    """

    def __init__(
        self,
        recorder: Recorder,
        clock: Clock,
        status: EngineStatus,
        on_status: Iterable[Callable[[EngineStatus], None]],
        on_step: Iterable[Callable[[StepRecord], None]],
        on_news: Iterable[Callable[[News], None]],
        end_run: Callable[[str], None],
    ) -> None:
        self.status = status
        self.lost: list[str] = []
        self._recorder = recorder
        self._clock = clock
        self._on_status, self._on_step, self._on_news = (
            [Listener[Any](each, end_run) for each in listeners]
            for listeners in (on_status, on_step, on_news)
        )

    def publish(self, **changes: Any) -> None:
        """Change the status, and tell it."""
        self.status = replace(self.status, **changes)
        self._tell(self.status, [*self._on_status, *self._on_news])

    def step(self, record: StepRecord) -> None:
        """Tell that a step is in the run file."""
        self.publish(steps_done=self.status.steps_done + 1)
        self._tell(record, [*self._on_step, *self._on_news])

    def event(self, level: Level, message: str) -> None:
        """Record an event and tell it."""
        entry = LogEntry(self._clock.now_s(), level, message)
        self._recorder.event(entry.time_s, level, "engine", message)
        self._tell(entry, self._on_news)

    def close(self, leaving_s: float) -> None:
        """Let the listeners handle the waiting reports, all together within a real time in s."""
        end_s = SystemClock().now_s() + leaving_s
        listeners = [*self._on_status, *self._on_step, *self._on_news]
        for each in listeners:
            each.leave()
        for each in listeners:
            each.join_until(end_s)
        self._note([sentence for each in listeners for sentence in (*each.take_failures(), *each.losses())])

    def _tell(self, report: News, listeners: list[Listener[Any]]) -> None:
        for each in listeners:
            each.put(report)
        self._note([sentence for each in listeners for sentence in each.take_failures()])

    def _note(self, failures: list[str]) -> None:
        self.lost += failures
        for failure in failures:
            try:
                self.event("warning", failure)
            except RigError:
                # At the end of a run the run file may be closed or broken, so the event may not be written.
                if not self.status.state.ending:
                    raise
