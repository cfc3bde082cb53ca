"""The progress bar of long commands, shown only on a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


class Bar:
    """A progress bar below the printed lines. If standard error is not a terminal, nothing is shown.

    All threads may use the same bar.
    """

    def __init__(self, drawn: "Progress | None", what: str, total: int | None) -> None:
        self._drawn = drawn
        if drawn is not None:
            self._task = drawn.add_task(what, total=total)

    def expect(self, total: int) -> None:
        """Set the total number of pieces of work."""
        if self._drawn is not None:
            self._drawn.update(self._task, total=total)

    def advance(self) -> None:
        """Count one piece of work as done."""
        if self._drawn is not None:
            self._drawn.advance(self._task)

    def describe(self, what: str, done: int) -> None:
        """Set the description of the work and the number of finished pieces of work."""
        if self._drawn is not None:
            self._drawn.update(self._task, description=what, completed=done)

    def show(self) -> None:
        """Show the progress bar again after `hide`."""
        if self._drawn is not None:
            self._drawn.start()

    def hide(self) -> None:
        """Remove the progress bar from the terminal until `show`, for example to ask the user a question."""
        # Stop only a bar that is drawn: otherwise Rich prints an empty line on a terminal without cursor
        # control.
        if self._drawn is not None and self._drawn.live.is_started:
            self._drawn.stop()


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Bar]:
    """Show a progress bar while the statements of a `with` block run.

    Parameters
    ----------
    what : str
        Description of the work, shown beside the progress bar.
    total : int, optional
        Total number of pieces of work. Without a total, the bar shows only that work is going on, until
        `Bar.expect` sets the total.
    """
    if not sys.stderr.isatty():
        yield Bar(None, what, total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # Rich prints lines on the terminal above the bar. If standard output is a file, leave it unchanged.
    with Progress(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty()
    ) as drawn:
        yield Bar(drawn, what, total)
