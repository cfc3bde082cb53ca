"""The progress of a run, shown on a terminal only."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rig.engine.status import State, Status


@contextmanager
def run_progress() -> Iterator[Callable[[Status], None]]:
    """Give a callback for `Engine` that draws a bar on stderr, or nothing where that is no terminal."""
    if not sys.stderr.isatty():
        yield lambda status: None
        return
    from rich.console import Console
    from rich.progress import Progress

    # A stdout that goes to a file must not be drawn into the bar's console.
    with Progress(
        console=Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty()
    ) as progress:
        task = progress.add_task("opening the rig", total=None)

        def show(status: Status) -> None:
            if status.state is State.PREPARING:
                # The operator is asked on this terminal: no bar may write over the question.
                progress.stop()
                return
            progress.start()
            what = "" if status.step is None else str(status.step)
            progress.update(
                task,
                description=f"{what} {status.state.value}{_values(status)}",
                total=status.steps_planned,
                completed=status.steps_done,
            )

        yield show


def _values(status: Status) -> str:
    values = {} if status.reading is None else status.reading.by_unit()
    return "".join(f", {value:.5g} {unit}" for unit, value in values.items())
