"""The two lines on the screen of a run have the right text. During a question nothing else is printed."""

import io
import re
import sys
import threading
from contextlib import redirect_stderr, redirect_stdout

import pytest

from drivers.interfaces import OperatorAction
from rig.commands.progress import Screen, how_to_stop, run_screen, what_happens
from rig.engine.status import EngineStatus, State
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import StepRecord

LOAD = ProtocolStep(2, "load", 2000.0)
DISPLACEMENT = ProtocolStep(12, "displacement", 0.3)
TURN = ProtocolStep(3, "rotation", 180.0)
GRID = ProtocolStep(0, "grid")


def status(state: State, step: ProtocolStep | None, *, moving: bool = False, **values: float) -> EngineStatus:
    reading = RigReading(1.0, moving=moving, **values) if values else None
    return EngineStatus(state, step, 24, 2, reading, simulated=True)


FRAME = {"load_n": 12345.67, "displacement_mm": 0.45678}
STAGE = {"angle_deg": 123.456}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (None, "opening the rig; nothing moves"),
        (
            status(State.MOVING, LOAD, moving=True, **FRAME),
            "step 2 (load 2000 N): the load frame MOVES, at 12345.7 N, 0.4568 mm",
        ),
        (
            status(State.MOVING, DISPLACEMENT, **FRAME),
            "step 12 (displacement 0.3 mm): the load frame settles, at 12345.7 N, 0.4568 mm",
        ),
        (
            status(State.MOVING, TURN, moving=True, **STAGE),
            "step 3 (rotation 180 deg): the stage MOVES, at 123.46 deg",
        ),
        (
            status(State.IMAGING, LOAD, **FRAME),
            "step 2 (load 2000 N): taking images, nothing moves, at 12345.7 N, 0.4568 mm",
        ),
        (
            status(State.IMAGING, LOAD, moving=True, **FRAME),
            "step 2 (load 2000 N): taking images, load frame MOVES, at 12345.7 N, 0.4568 mm",
        ),
        (
            status(State.PREPARING, GRID, moving=True, **STAGE),
            "preparing the grid: the stage MOVES to 0 deg, at 123.46 deg",
        ),
        (
            status(State.PREPARING, GRID, **FRAME),
            "preparing the grid: nothing moves, at 12345.7 N, 0.4568 mm",
        ),
        (
            status(State.MOVING, GRID, **FRAME),
            "step 0 (grid): waiting until nothing moves, at 12345.7 N, 0.4568 mm",
        ),
        (status(State.SAFING, LOAD, **FRAME), "stopping: the load frame is to hold, the stage is to stop"),
    ],
)
def test_the_first_line_says_what_moves_and_why(given, said):
    assert what_happens(given) == said
    assert len(said) <= 80


def test_the_second_line_says_what_ctrl_c_does_on_this_rig():
    assert how_to_stop(None) == "Ctrl-C: the run ends"
    assert how_to_stop(status(State.MOVING, TURN, **STAGE)) == "Ctrl-C: the stage stops"
    both = status(State.MOVING, TURN, **STAGE, **FRAME)
    assert how_to_stop(both) == "Ctrl-C: the load frame holds, the stage stops"


class Terminal(io.StringIO):
    """A terminal that records the written text."""

    def isatty(self) -> bool:
        return True


def without_codes(text: str) -> str:
    return re.sub(r"\x1b\[[?\d;]*[A-Za-z]", "", text)


def test_nothing_else_is_written_during_a_question_and_steps_follow_after_it():
    terminal = Terminal()
    record = StepRecord(LOAD, RigReading(1.0, **FRAME), {"on_axis": (0, 1)})
    with redirect_stdout(terminal), redirect_stderr(terminal), run_screen() as screen:
        screen.on_step(record)
        screen.on_step(record)
        screen.on_status(status(State.PREPARING, ProtocolStep(1, "reference"), **FRAME))
        with screen.on_question(OperatorAction.REMOVE_GRID, ""):
            before = terminal.tell()
            screen.on_status(status(State.PREPARING, ProtocolStep(1, "reference"), **FRAME))
            screen.on_step(record)
            assert not screen.live.is_started
            assert terminal.tell() == before
        assert screen.live.is_started
    said = without_codes(terminal.getvalue())
    line = "step 2 (load 2000 N): settled at 12345.7 N, 0.4568 mm; images: 1 on_axis\n"
    question = "Nothing moves: the load frame holds at 12345.7 N, 0.4568 mm.\n"
    assert said.count(line) == 3
    assert said.index(line) < said.index(question) < said.rindex(line)


def test_a_question_comes_after_the_lines_of_all_finished_steps():
    """The line of the second step arrives late, from another thread."""
    terminal = Terminal()
    record = StepRecord(LOAD, RigReading(1.0, **FRAME), {"on_axis": (0, 1)})
    with redirect_stdout(terminal), redirect_stderr(terminal), run_screen(60.0) as screen:
        screen.on_status(status(State.PREPARING, GRID, **FRAME))
        screen.on_step(record)
        late = threading.Timer(0.05, screen.on_step, [record])
        late.start()
        with screen.on_question(OperatorAction.ATTACH_GRID, ""):
            late.join()
    said = without_codes(terminal.getvalue())
    assert said.rindex("settled at") < said.index("Nothing moves")


def test_what_a_simulated_operator_does_is_shown_and_the_lines_stay():
    terminal = Terminal()
    with redirect_stdout(terminal), redirect_stderr(terminal), run_screen() as screen:
        screen.on_status(status(State.PREPARING, GRID, **FRAME))
        with screen.on_question(OperatorAction.ATTACH_GRID, "simulated operator: attaches, 60 s"):
            assert screen.live.is_started
            screen.live.refresh()
    assert "simulated operator: attaches, 60 s" in without_codes(terminal.getvalue())


def test_a_pipe_gets_the_steps_and_nothing_else():
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), run_screen() as screen:
        screen.on_status(status(State.PREPARING, GRID, **FRAME))
        with screen.on_question(OperatorAction.ATTACH_GRID, "simulated operator: attaches, 60 s"):
            pass
        screen.on_step(StepRecord(LOAD, RigReading(1.0, **FRAME), {"on_axis": (0, 1)}))
    assert out.getvalue() == "step 2 (load 2000 N): settled at 12345.7 N, 0.4568 mm; images: 1 on_axis\n"
    assert err.getvalue() == ""
    assert sys.stdout is not out


def test_a_run_asks_only_when_the_terminal_is_free(tension):
    terminal = Terminal()
    asked = []
    with redirect_stdout(terminal), redirect_stderr(terminal), run_screen() as screen:
        tension.operator.on_perform = lambda action: asked.append(screen.live.is_started)
        listeners = {"on_status": [screen.on_status], "on_step": [screen.on_step]}
        outcome = tension.engine(**listeners, on_question=screen.on_question).run()
    assert outcome.status == "completed"
    assert asked == [False, False]
    assert without_codes(terminal.getvalue()).count(": settled at ") == outcome.steps_done


def test_the_end_of_a_run_leaves_no_drawing():
    terminal = Terminal()
    with redirect_stdout(terminal), redirect_stderr(terminal), run_screen() as screen:
        screen.on_status(status(State.SAFING, LOAD, **FRAME))
        with screen.on_question(OperatorAction.ATTACH_GRID, ""):
            pass
        assert not screen.live.is_started
    assert isinstance(screen, Screen)
