"""The progress of a run, shown on a terminal only."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from dic.shell.progress import progress
from rig import State, Status


@contextmanager
def run_progress() -> Iterator[Callable[[Status], None]]:
    """Give a listener for `Engine` that draws a bar on standard error, if that is a terminal."""
    with progress("opening the rig") as bar:

        def show(status: Status) -> None:
            if status.step is not None:
                bar.expect(status.steps_planned)
                bar.describe(f"{status.step} {status.state.value}{_values(status)}", status.steps_done)
            if status.state in (State.MOVING, State.IMAGING):
                bar.show()
            elif status.state is State.PREPARING:
                # The operator is asked on this terminal: no bar may write over the question.
                bar.hide()

        yield show


def _values(status: Status) -> str:
    values = {} if status.reading is None else status.reading.by_unit()
    return "".join(f", {value:.5g} {unit}" for unit, value in values.items())
