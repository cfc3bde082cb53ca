"""Progress of a long command: one bar on the terminal, the same for all commands, and nothing elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


class Bar:
    """A bar under what is printed; all methods do nothing where standard error is no terminal.

    It may be used from any thread.
    """

    def __init__(self, drawn: "Progress | None", what: str, total: int | None) -> None:
        self._drawn = drawn
        if drawn is not None:
            self._task = drawn.add_task(what, total=total)

    def expect(self, total: int) -> None:
        """Say how many pieces of work there are."""
        if self._drawn is not None:
            self._drawn.update(self._task, total=total)

    def advance(self) -> None:
        """Count one piece of work as done."""
        if self._drawn is not None:
            self._drawn.advance(self._task)

    def describe(self, what: str, done: int) -> None:
        """Say what is being done, and how many pieces are done."""
        if self._drawn is not None:
            self._drawn.update(self._task, description=what, completed=done)

    def show(self) -> None:
        """Draw the bar again."""
        if self._drawn is not None:
            self._drawn.start()

    def hide(self) -> None:
        """Take the bar off the terminal, so that somebody can be asked there, until it is to `show` again."""
        # Rich stops a bar that is not drawn by an empty line on terminals that cannot move their cursor.
        if self._drawn is not None and self._drawn.live.is_started:
            self._drawn.stop()


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Bar]:
    """Show a bar while the block runs.

    Parameters
    ----------
    what : str
        What is being done.
    total : int, optional
        Pieces of work. Without it the bar shows only that the work goes on, until told what to `expect`.
    """
    if not sys.stderr.isatty():
        yield Bar(None, what, total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # What is printed goes to the bar's terminal, above the bar; a standard output that is a file must not.
    with Progress(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty()
    ) as drawn:
        yield Bar(drawn, what, total)
