"""The progress bar of long commands, shown only on a terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


class Bar:
    """A bar below the printed lines; all methods do nothing if standard error is not a terminal.

    The bar can be used from any thread.
    """

    def __init__(self, drawn: "Progress | None", what: str, total: int | None) -> None:
        self._drawn = drawn
        if drawn is not None:
            self._task = drawn.add_task(what, total=total)

    def expect(self, total: int) -> None:
        """Set the number of pieces of work."""
        if self._drawn is not None:
            self._drawn.update(self._task, total=total)

    def advance(self) -> None:
        """Count one piece of work as done."""
        if self._drawn is not None:
            self._drawn.advance(self._task)

    def describe(self, what: str, done: int) -> None:
        """Set the description of the work and the number of finished pieces."""
        if self._drawn is not None:
            self._drawn.update(self._task, description=what, completed=done)

    def show(self) -> None:
        """Draw the bar again."""
        if self._drawn is not None:
            self._drawn.start()

    def hide(self) -> None:
        """Remove the bar from the terminal, for example to ask a question, until `show`."""
        # On terminals without cursor control, Rich prints an empty line when it stops a bar that is not
        # drawn.
        if self._drawn is not None and self._drawn.live.is_started:
            self._drawn.stop()


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Bar]:
    """Show a bar while the block runs.

    Parameters
    ----------
    what : str
        Description of the work.
    total : int, optional
        Number of pieces of work. Without a number the bar shows only activity, until `expect` sets one.
    """
    if not sys.stderr.isatty():
        yield Bar(None, what, total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # Printed lines appear on the terminal above the bar; a standard output that is a file is not redirected.
    with Progress(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty()
    ) as drawn:
        yield Bar(drawn, what, total)
