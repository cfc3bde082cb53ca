"""Follow what a run tells of itself, on a terminal or as lines, until it has ended."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.clock import Clock
from rig import EngineStatus
from rig.commands.live_view import Panel, RunView
from rig.commands.news_sources import Seen, Source
from rig.commands.progress import BAR_WIDTH, what_happens
from rig.news import wording

if TYPE_CHECKING:
    from rich.console import RenderableType

POLL_S = 0.5
"""Time in s between two readings of the news, which a run writes at most once per second."""
TOLD_EVERY_S = 10.0
"""Shortest time in s between two lines, where no terminal shows the run."""
REFRESHES_PER_S = 4.0


@dataclass(frozen=True)
class Verdict:
    """How it stands with a run.

    Attributes
    ----------
    sentence : str
    good : bool
        True if the run goes on, or was completed.
    over : bool
        True if no news will follow.
    """

    sentence: str
    good: bool
    over: bool


def judge(seen: Seen) -> Verdict:
    """Return whether a run goes on, has ended, or gives no news."""
    run, done = seen.run, steps_done(seen.run.status)
    if run.ended:
        why = f": {run.reason}" if run.reason else ""
        return Verdict(f"the run has ended, {run.ended}, {done}{why}", run.ended == "completed", over=True)
    if seen.lost:
        return Verdict(f"{seen.lost}. {_what_to_see(run.status)}", good=False, over=True)
    if seen.age_s > run.stale_after_s:
        return Verdict(
            f"NO NEWS for {seen.age_s:.0f} s, which come every second: the run hangs or was killed, or the "
            f"clocks of two computers differ. {_what_to_see(run.status)}",
            good=False,
            over=False,
        )
    return Verdict(f"the run goes on, {done}", good=True, over=False)


def steps_done(status: EngineStatus) -> str:
    """Return the number of finished steps; of an acquisition nobody knows how many will follow."""
    planned = "" if status.acquisition is not None else f" of {status.steps_planned}"
    return f"{status.steps_finished}{planned} steps"


def _what_to_see(status: EngineStatus) -> str:
    told = "rig status RIG reads the machines, rig verify RUN tells what was recorded"
    if status.load_is_measured:
        return f"The load frame takes no commands: see for yourself what it does. {told}"
    return f"The guardian stops the machines of such a run: see for yourself that they stand. {told}"


class Watch:
    """Follows a run.

    Parameters
    ----------
    source : Source
    clock : Clock
    say : callable
        Called with each line to print.
    """

    def __init__(self, source: Source, clock: Clock, say: Callable[[str], None]) -> None:
        self._source, self._clock, self._say = source, clock, say
        self.seen = source.read()
        self.verdict = judge(self.seen)
        self._told_s, self._told = -math.inf, ""

    def follow(self, *, drawn: bool) -> None:
        """Read the news until the run has ended. If they are not `drawn`, print lines."""
        while not self.verdict.over:
            if not drawn:
                self._tell_now_and_then()
            self._clock.sleep(POLL_S)
            self.seen = self._source.read()
            self.verdict = judge(self.seen)

    def lines(self) -> list[str]:
        """Return all that is known of the run, as lines."""
        run = self.seen.run
        simulated = "SIMULATED: " if run.status.simulated else ""
        told = [f"{simulated}{run.title}, {run.run_file}", self.verdict.sentence]
        if not run.ended:
            told += [what_happens(run.status)]
        if run.status.live is None:
            told += [f"{run.running_s:.1f} s since the first reading"] * (not math.isnan(run.running_s))
        return told + [line for line, _ in self._view.lines()]

    def table(self) -> dict[str, Any]:
        """Return what the run told at last and what it means, for JSON."""
        run, verdict = self.seen.run, self.verdict
        return {
            "source": self._source.name,
            "title": run.title,
            "run_file": run.run_file,
            "verdict": verdict.sentence,
            "good": verdict.good,
            "over": verdict.over,
            "age_s": wording.number(self.seen.age_s),
            "running_s": wording.number(run.running_s),
            "ended": run.ended or None,
            "reason": run.reason or None,
            "images": wording.images_table(run.images),
            **wording.status_table(run.status),
        }

    def draw(self) -> "RenderableType":
        """Return the lines at the bottom of a terminal, for Rich."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        run, verdict = self.seen.run, self.verdict
        status = run.status
        above = [(what_happens(status), False)]
        above += [] if verdict.good else [(verdict.sentence, True)]
        above += [(f"{run.title}, {run.run_file}", False)]
        below = Table.grid(padding=(0, 1))
        simulated = "SIMULATED, " if status.simulated else ""
        counted = steps_done(status)
        below.add_row(
            ProgressBar(status.steps_planned, status.steps_finished, BAR_WIDTH),
            Text(f"{simulated}{counted}, Ctrl-C: leave; the run goes on", no_wrap=True, overflow="ellipsis"),
        )
        return Panel(self._view, above, below)

    @property
    def _view(self) -> RunView:
        run = self.seen.run
        return RunView(run.status, run.running_s, run.images)

    def _tell_now_and_then(self) -> None:
        """Print a line in `TOLD_EVERY_S`, and at once if the run gives no news any more or again."""
        kind = "" if self.verdict.good else "bad"
        now_s = self._clock.now_s()
        if now_s - self._told_s < TOLD_EVERY_S and kind == self._told:
            return
        self._told_s, self._told = now_s, kind
        self._say(
            self.verdict.sentence
            if kind
            else self._view.sentence() or f"{what_happens(self.seen.run.status)}; {self.verdict.sentence}"
        )
