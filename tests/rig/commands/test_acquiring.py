"""The screen and the keys of a run that takes images at times or events."""

import io
import re
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import replace

import numpy as np
import pytest

from rig.commands.acquiring import SUMMARY_S, SummaryLines, what_is_taken
from rig.commands.pause_key import PauseKey
from rig.commands.progress import how_to_stop, run_screen, what_happens
from rig.engine.status import EngineStatus, State
from rig.engine.timing import TimingNow
from rig.protocol.acquire import Acquisition
from rig.protocol.acquisition_tables import End, Schedule
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import StepRecord
from rig.samples import SignalReading
from tests.rig.engine.test_acquisition import beside, with_tables

PART = Acquisition(Schedule(every_s=0.5), End(duration_s=600.0))
STEP = PART.step(4, 0, 0.0)
VALUES = {
    "force": SignalReading(np.array([1.0, 12345.6]), np.zeros(2), unit="N"),
    "oven": SignalReading(np.array([23.46]), np.zeros(1), unit="°C"),
}
NOW = TimingNow(asked=124, taken=120, late=0, missing=0, planned=1201, interval_s=0.5, reached_s=0.5021)


def status(now: TimingNow, state: State = State.IMAGING, **more) -> EngineStatus:
    reading = RigReading(1.0, load_n=12345.6, signals=VALUES)
    return EngineStatus(state, STEP, 1201, 120, reading, acquisition=now, load_is_measured=True, **more)


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (NOW, "120 of 1201 images, every 0.5 s (0.502 s reached), force 12346 N, oven 23.46 °C"),
        (
            TimingNow(130, 120, 3, 7, 1201, 0.5, 1.18),
            "120 of 1201 images, 3 LATE, 7 MISSING, every 0.5 s (1.18 s reached), "
            "force 12346 N, oven 23.46 °C",
        ),
        (
            TimingNow(0, 0, 0, 0, None, np.nan, np.nan, "channels.force above 10"),
            "waiting for channels.force above 10, force 12346 N, oven 23.46 °C",
        ),
        (TimingNow(5, 5, 0, 0, None, np.nan, 3.0), "5 images, force 12346 N, oven 23.46 °C"),
    ],
)
def test_the_first_line_tells_images_rates_and_values(now, said):
    assert what_happens(status(now)) == said
    assert what_is_taken(status(now, State.PAUSED), now) == f"PAUSED: {said}"


def test_a_load_frame_that_is_pulled_without_a_stop_is_said_to_move_and_gauges_are_not_told_twice():
    gauge = {"gauge.axial": SignalReading(np.array([0.004]), np.zeros(1), unit="1")}
    pulls = RigReading(1.0, load_n=5.0, moving=True, signals={**gauge, **VALUES})
    said = what_happens(replace(status(NOW), reading=pulls, load_is_measured=False))
    assert said.startswith("the load frame MOVES, 120 of 1201 images, ")
    assert said.endswith("reached), force 12346 N, oven 23.46 °C")
    stands = replace(status(NOW, State.PAUSED), reading=replace(pulls, moving=False), load_is_measured=False)
    assert what_happens(stands).startswith("PAUSED: nothing moves, 120 of")
    # of a machine that is no device of the rig nobody knows whether it moves
    assert "moves" not in what_happens(replace(stands, reading=RigReading(1.0, angle_deg=0.0)))


def test_no_line_claims_that_a_machine_stands_or_is_stopped_that_takes_no_commands():
    for state in State:
        for step in (STEP, ProtocolStep(0, "grid"), ProtocolStep(2, "static")):
            reading = RigReading(1.0, load_n=5.0)
            given = EngineStatus(state, step, 3, 1, reading, load_is_measured=True)
            assert "nothing moves" not in what_happens(given), (state, step)
            assert "holds" not in how_to_stop(given)


def test_a_question_beside_a_closed_machine_tells_to_look_at_it():
    """A load without a displacement must not be a mistake either."""
    out, err = io.StringIO(), io.StringIO()
    err.isatty = lambda: True
    with redirect_stdout(out), redirect_stderr(err), run_screen() as screen:
        screen.on_status(
            EngineStatus(State.PREPARING, STEP, 3, 0, RigReading(1.0, load_n=5.0), load_is_measured=True)
        )
        with screen.on_question(None, ""):
            pass
    assert "takes no commands, and shows 5.0 N: see for yourself that it stands" in err.getvalue()


def test_thousands_of_images_give_few_lines():
    lines = SummaryLines()
    record = StepRecord(PART.step(4, 119, 59.5), RigReading(1.0), {})
    said = [lines.of(record, status(NOW), 0.1 * k) for k in range(1000)]
    printed = [line for line in said if line]
    assert len(printed) == 100.0 // SUMMARY_S
    assert printed[0].startswith("step 123 (acquired after 59.5 s): 120 of 1201 images, every 0.5 s (0.502 s")


def test_a_pipe_gets_the_first_image_and_not_each(tmp_path):
    rig = beside(tmp_path, with_tables("every_s = 0.05", "images = 200"))
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), run_screen() as screen:
        outcome = rig.engine(on_status=[screen.on_status], on_step=[screen.on_step]).run()
    assert outcome.steps_done == 200
    lines = out.getvalue().splitlines()
    # the reference, and the first of the others
    assert len(lines) == 2
    assert re.match(r"step 1 \(acquired after 0\.05\d* s\): ", lines[1])


class SomeKeys:
    """Presses some keys, and ends the thread that listens then."""

    there = True

    def __init__(self, keys: str) -> None:
        self.left = list(keys)
        self.listener: PauseKey | None = None

    def next(self, _: int) -> str:
        if self.left:
            return self.left.pop(0)
        self.listener._ended = True
        return ""


class NotedEngine:
    def __init__(self) -> None:
        self.asked = []

    def request_image(self) -> str:
        self.asked.append("image")
        return ""

    def request_end(self) -> str:
        self.asked.append("end")
        return ""

    def pause(self, who: str, *, at_machine: bool) -> str:
        self.asked.append("pause")
        return ""


@pytest.mark.parametrize(
    ("keys", "asked"),
    [
        ("ixI", ["image", "image"]),
        ("e", []),
        ("ee", ["end"]),
        ("exe", ["end"]),
        ("p", ["pause"]),
        ("q\x7f\n", []),
    ],
)
def test_keys_ask_for_images_and_only_two_presses_end_them(keys, asked):
    engine, pressed = NotedEngine(), SomeKeys(keys)

    @contextmanager
    def free():
        yield

    pressed.listener = PauseKey(engine, free, pressed)
    pressed.listener.run()
    assert engine.asked == asked
    with suppress(OSError):
        pressed.listener.leave() if pressed.listener.is_alive() else None
