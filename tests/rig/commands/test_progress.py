"""What the bar of a run shows, and that it is gone while the operator is asked."""

from contextlib import contextmanager

import pytest

from rig.commands import progress
from rig.commands.progress import run_progress
from rig.engine.status import State, Status
from rig.protocol.step import ProtocolStep, Reading


class NotedBar:
    """A bar that notes what it is told."""

    def __init__(self) -> None:
        self.total = self.done = 0
        self.what = ""
        self.shown = True

    def expect(self, total: int) -> None:
        self.total = total

    def describe(self, what: str, done: int) -> None:
        self.what, self.done = what, done

    def show(self) -> None:
        self.shown = True

    def hide(self) -> None:
        self.shown = False


@pytest.fixture
def noted(monkeypatch) -> NotedBar:
    bar = NotedBar()

    @contextmanager
    def given(what: str):
        bar.what = what
        yield bar

    monkeypatch.setattr(progress, "progress", given)
    return bar


def test_the_bar_says_step_state_values_and_how_many_steps_are_done(noted):
    with run_progress() as listener:
        assert noted.what == "opening the rig"
        reading = Reading(1.0, load_n=1999.5, displacement_mm=0.25)
        listener(Status(State.MOVING, ProtocolStep(2, "load", 2000.0), 24, 2, reading))
    assert noted.what == "step 2 (load 2000 N) moving, 1999.5 N, 0.25 mm"
    assert (noted.done, noted.total) == (2, 24)


def test_the_bar_is_gone_whenever_the_operator_is_asked(tension, noted):
    asked = []
    tension.operator.on_perform = lambda action: asked.append(noted.shown)
    imaging = []
    tension.cameras["on_axis"].on_grab = lambda count, frame: imaging.append(noted.shown) or frame
    with run_progress() as listener:
        assert tension.engine(on_status=[listener]).run().status == "completed"
    assert asked == [False, False]
    assert all(imaging)


def interrupt(action: object) -> None:
    raise KeyboardInterrupt


def test_an_end_while_the_operator_is_asked_does_not_write_over_the_question(tension, noted):
    tension.operator.on_perform = interrupt
    with run_progress() as listener, pytest.raises(KeyboardInterrupt):
        tension.engine(on_status=[listener]).run()
    assert tension.states[-1] == "FAILED"
    assert not noted.shown
