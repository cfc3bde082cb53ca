"""A terminal that accepts no output, for example after Ctrl-S, does not delay a run."""

import os
import signal
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from subprocess import DEVNULL, Popen, TimeoutExpired

import pytest

from dic.runfile.reader import RunFile
from rig.commands.progress import run_screen
from rig.engine.listeners import QUEUED_NEWS
from tests.command_line import RIG
from tests.places import example


class Terminal:
    """A pseudo-terminal for standard output and standard error of a program."""

    def __init__(self) -> None:
        self._screen, self._line = os.openpty()
        self.stream = os.fdopen(self._line, "w", buffering=1)
        self._reading = threading.Thread(target=self._read)

    def stall(self) -> None:
        """Stop the terminal's output as Ctrl-S does, so that each write to the terminal blocks."""
        termios.tcflow(self._line, termios.TCOOFF)

    def let_go(self) -> None:
        """Continue the terminal's output as Ctrl-Q does, and read the written text."""
        if not self._reading.is_alive():
            self._reading.start()
        termios.tcflow(self._line, termios.TCOON)

    def read_up_to(self, text: bytes) -> None:
        """Read the written text up to and including `text`."""
        seen = b""
        while text not in seen:
            seen += os.read(self._screen, 4096)

    def close(self) -> None:
        self.stream.close()
        self._reading.join()
        os.close(self._screen)

    def _read(self) -> None:
        try:
            while os.read(self._screen, 4096):
                pass
        except OSError:  # the other side is closed
            return


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.let_go()
    made.close()


@contextmanager
def news_on(terminal: Terminal) -> Iterator[dict[str, list]]:
    """Yield the listeners of `rig run` for this terminal, and let the output continue after the block."""
    with redirect_stdout(terminal.stream), redirect_stderr(terminal.stream), run_screen() as screen:
        assert screen.live is not None
        yield {"on_status": [screen.on_status], "on_step": [screen.on_step]}
        terminal.let_go()
        for thread in threading.enumerate():
            if thread.name.startswith("listener"):
                thread.join()


def test_run_goes_on_to_its_end_while_the_terminal_is_stalled(tension, terminal):
    """Whatever is written on the terminal blocks from the first question on, the bar and the steps' lines."""
    tension.operator.on_perform, tension.leaving_s = lambda action: terminal.stall(), 1.0
    with news_on(terminal) as listeners:
        outcome = tension.engine(**listeners).run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert len(outcome.steps) == outcome.steps_done > 10
    assert len(tension.events()) > 0
    # It is said that news were lost, and how many.
    assert any("does not return from a call; it has missed" in lost for lost in outcome.lost_listeners)


def test_failing_run_is_made_safe_while_the_terminal_is_stalled(tension, terminal, on_frame_state):
    tension.operator.on_perform, tension.leaving_s = lambda action: terminal.stall(), 1.0
    tension.load_frame.on_read = on_frame_state(60, faults=("overtravel",))
    with news_on(terminal) as listeners:
        outcome = tension.engine(**listeners).run()
    assert (outcome.status, outcome.unsafe) == ("failed", ())
    assert tension.load_frame.reads == 60 + 1  # and once more, to say what holds
    assert tension.calls[-1] == "hold"


def test_steps_of_the_outcome_do_not_depend_on_what_a_listener_was_told(tension):
    never, tension.leaving_s = threading.Event(), 1.0
    outcome = tension.engine(on_step=[lambda record: never.wait()]).run()
    never.set()
    assert outcome.status == "completed"
    assert [record.step.kind for record in outcome.steps][:3] == ["grid", "reference", "load"]
    assert len(outcome.steps) == outcome.steps_done


def test_slow_listener_loses_the_oldest_news_and_their_number_is_said(rotation_table, rotation):
    """The listener is stuck in its first call until all others are told, and is then given what is kept."""
    told, first, go_on = [], threading.Event(), threading.Event()

    def slow(status) -> None:
        told.append(status)
        first.set()
        go_on.wait(60.0)

    def end(status) -> None:
        first.wait(60.0)
        if status.state.ending:
            go_on.set()

    rotation_table["settle"]["poll_s"] = 0.005
    rotation.protocol = type(rotation.protocol).model_validate(rotation_table)
    outcome = rotation.engine(on_status=[slow, end]).run()
    assert outcome.status == "completed"
    assert len(told) == QUEUED_NEWS + 1
    assert told[-1].state.ending
    (lost,) = [each for each in outcome.lost_listeners if "slow" in each]
    assert "was too slow and has missed" in lost


REAL_TIME = ('driver = "virtual-rig"', 'driver = "virtual-rig"\nreal_time = true')
SMALL = ('driver = "simulated-camera"', 'driver = "simulated-camera"\nwidth_px = 32\nheight_px = 24')
AT_ONCE = ('driver = "simulated-operator"', 'driver = "simulated-operator"\nduration_s = 0.0')


@pytest.mark.realtime
@pytest.mark.extended
def test_signal_ends_a_run_and_then_the_program_although_nothing_can_be_written(terminal, tmp_path):
    """The program hangs in its last line, as it should: somebody may read on. A further signal ends it."""
    protocol, rig_path, run_path = (tmp_path / name for name in ("protocol.toml", "rig.toml", "run.h5"))
    protocol.write_text(example("rotation", ("increment_deg = 22.5", "increment_deg = 1.0")))
    rig_path.write_text(example("rig-virtual-rotation-10", REAL_TIME, SMALL, AT_ONCE))
    command = list(map(str, [*RIG, "run", protocol, "--rig", rig_path, "-o", run_path]))
    with Popen(
        [*map(str, command)], stdin=DEVNULL, stdout=terminal.stream, stderr=terminal.stream
    ) as process:
        terminal.read_up_to(b"step 1 ")
        terminal.stall()
        while process.poll() is None:
            process.send_signal(signal.SIGTERM)
            with suppress(TimeoutExpired):
                process.wait(1.0)
    assert process.returncode == -signal.SIGTERM
    with RunFile(run_path) as written:
        assert written.info.status == "aborted"
