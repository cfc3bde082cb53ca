"""What commands say besides their results: progress on a terminal, complaints on standard error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click


def fail(sentence: str) -> None:
    """Print a sentence about what could not be done."""
    click.echo(f"error: {sentence}", err=True)


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[], None]]:
    """Show progress over `total` pieces of work, on a terminal only; yields the function that counts one."""
    with counted_progress(what) as (on_count, advance):
        on_count(total)
        yield advance


@contextmanager
def counted_progress(what: str) -> Iterator[tuple[Callable[[int], None], Callable[[], None]]]:
    """Show progress over work whose extent is not known yet.

    Yields the function that is told the number of pieces, and the one that counts a piece.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda total: bar.update(task, total=total), lambda: bar.advance(task)
