"""The progress bar of long commands, shown only on a terminal."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING

from dic.shell.bottom_lines import bottom_lines

if TYPE_CHECKING:
    from rich.live import Live
    from rich.progress import Progress

_REFRESHES_PER_S = 10.0
_ESTIMATE_S = 180.0
"""The remaining time follows from the pieces of work that ended in this time, so each must be shorter.

With Rich's default of 30 s, no remaining time would be shown for large images. A longer time would count too
many images that were finished before an interruption, because these are read in no time.
"""


class Bar:
    """A progress bar below the printed lines, which is shown only where `bottom_lines` may draw.

    All threads may use the same bar.
    """

    def __init__(self, what: str, total: int | None) -> None:
        self._live: Live | None = bottom_lines(lambda: self._bar, _REFRESHES_PER_S)
        if self._live is not None:
            self._task = self._bar.add_task(what, total=total)

    @cached_property
    def _bar(self) -> "Progress":
        """The bar of the library Rich, made only when it is drawn, because Rich takes time to load."""
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        return Progress(*columns, auto_refresh=False, speed_estimate_period=_ESTIMATE_S)

    def expect(self, total: int) -> None:
        """Set the total number of pieces of work."""
        if self._live is not None:
            self._bar.update(self._task, total=total)

    def advance(self) -> None:
        """Count one piece of work as done."""
        if self._live is not None:
            self._bar.advance(self._task)

    def advance_of(self, total: int) -> None:
        """Count one of `total` pieces of work as done."""
        self.expect(total)
        self.advance()

    def describe(self, what: str, done: int) -> None:
        """Set the description of the work and the number of finished pieces of work."""
        if self._live is not None:
            self._bar.update(self._task, description=what, completed=done)

    def show(self) -> None:
        """Show the progress bar, also again after `hide`."""
        if self._live is not None:
            self._live.start(refresh=True)

    def hide(self) -> None:
        """Remove the progress bar from the terminal until `show`, for example to ask the user a question."""
        if self._live is not None and self._live.is_started:
            self._live.stop()


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Bar]:
    """Show a progress bar while the statements of a `with` block run.

    `what`: description of the work, shown beside the progress bar. `total`: total number of pieces of work.
    Without a total, the bar shows only that work is going on, until `Bar.expect` sets the total.
    """
    bar = Bar(what, total)
    bar.show()
    try:
        yield bar
    finally:
        bar.hide()
