"""A run is paused and goes on where it stood: motions, holds, questions, limits, aborts, and the replay."""

import tomllib
from dataclasses import replace

import h5py
import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.verify import verify_run
from rig.engine.engine import Engine
from rig.engine.status import PauseTotals
from rig.protocol.protocol import parse_protocol
from rig.replay.replay import replay_run
from rig.resume import read_earlier
from tests.places import example
from tests.rig.conftest import FakeRig
from tests.rig.engine.test_phases import SLOW, readings_of, steps_of
from tests.rig.protocol.test_phases import CYCLES, HOLD, MOVING, TURNING, text
from tests.rig.replay.test_replay import identical

TO_LOAD = HOLD.split("[[phases]]")[1]
TURN = '[[phases]]\ndo = "rotate"\nangle_deg = 90.0\nimages.every_deg = 45.0\n'
PROTOCOLS = {
    "to-load": text(f"[[phases]]{TO_LOAD}", SLOW),
    "creep": text(HOLD, SLOW),
    "moving": text(MOVING, SLOW),
    "cycles": text(CYCLES, SLOW),
    "rotate": text(TURN, TURNING),
}


LONGER = pytest.mark.extended


class Paused:
    """A run that is paused once at the reading `first`, and goes on after `readings` further readings.

    `first` is the number of the reading, or a load in N that the reading is above.
    """

    def __init__(self, tmp_path, name: str, first: int | float, readings: int, definition: str = "") -> None:
        definition = definition or PROTOCOLS.get(name) or example(name)
        self.rig = FakeRig(
            parse_protocol(tomllib.loads(definition)), tmp_path / "run.h5", definition=definition
        )
        self.engine: Engine = self.rig.engine()
        self.count = 0
        self.first, self.readings = first, readings
        self.stops = {}
        self.then = (0, lambda: None)
        if self.rig.load_frame is not None:
            self.rig.load_frame.on_read = lambda _, state: self.note(state)
        else:
            self.rig.stage.on_read = self.note

    @property
    def begins(self) -> int:
        """The number of the reading at which the pause was requested."""
        return self.first

    def go_on(self) -> None:
        self.engine.go_on("a test")

    def note(self, state):
        self.count += 1
        if isinstance(self.first, float) and state.load_n > self.first:
            self.first = self.count
        if self.count == self.first:
            self.engine.pause("a test")
        if self.count == self.first + self.readings:
            self.go_on()
        self.stops.get(self.count, lambda: None)()
        if self.count == self.first + self.then[0]:
            self.then[1]()
        return state

    def run(self):
        return self.engine.run()


def test_a_motion_is_held_and_commanded_again(tmp_path):
    made = Paused(tmp_path, "to-load", 2000.0, 300)
    outcome = made.run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert [call for call in made.rig.calls if call.startswith("load")] == ["load 4000"] * 2
    assert "PAUSED" in made.rig.states
    between = made.rig.calls[made.rig.calls.index("load 4000") + 1 :]
    assert between[0] == "hold"
    loads_n, times_s = (readings_of(made.rig)[name] for name in ("load_n", "time_s"))
    # it stood for as long as it was paused, below the target, and then arrived
    first = made.begins
    standing = np.flatnonzero(np.diff(loads_n[first : first + 300]) == 0.0)
    assert len(standing) > 295
    assert 2000.0 < loads_n[first + 100] < 2500.0
    assert loads_n[-1] == pytest.approx(4000.0, abs=20.0)
    assert outcome.pauses.count == 1
    assert outcome.pauses.duration_s == pytest.approx(times_s[first + 299] - times_s[first - 1], abs=2.1)
    assert (outcome.pauses.late_steps, outcome.pauses.missed_steps) == (0, 0)
    assert [event for event in made.rig.events() if " by a test" in event] == [
        "paused in step 2 (settling) by a test",
        f"goes on by a test after {outcome.pauses.duration_s:.1f} s",
    ]


def test_the_images_of_a_motion_wait_so_that_they_show_the_same_displacements(tmp_path):
    made = Paused(tmp_path, "moving", 40, 120)
    outcome = made.run()
    assert outcome.status == "completed", outcome.reason
    assert outcome.pauses.duration_s > 100.0
    assert (outcome.pauses.late_steps, outcome.pauses.missed_steps) == (0, 0)
    with h5py.File(made.rig.path) as file:
        ways_mm = file["entry/steps/displacement_mm"][2:]
    assert ways_mm[:3] == pytest.approx([0.3, 0.6, 0.9], abs=0.03)
    assert ways_mm[3] == pytest.approx(1.0, abs=0.002)


def reading_in_hold(tmp_path) -> int:
    """Return the number of a reading 30 s before the first images of the hold."""
    free = Paused(tmp_path, "creep", 10**6, 1)
    assert free.run().status == "completed"
    [imaged_s, *_] = [time_s for kind, _, time_s, _ in steps_of(free.rig) if kind == "creep"]
    times_s = readings_of(free.rig)["time_s"]
    free.rig.path.unlink()
    return int(np.searchsorted(times_s, imaged_s - 30.0))


@pytest.mark.parametrize(
    ("readings", "late", "missed", "kinds"),
    [(20, 0, 0, 3), (60, 1, 0, 3), (90, 1, 1, 2), (150, 1, 2, 1)],
)
def test_images_of_a_hold_that_fell_into_a_pause_are_late_or_missed_and_never_invented(
    tmp_path, readings, late, missed, kinds
):
    made = Paused(tmp_path, "creep", reading_in_hold(tmp_path), readings)
    outcome = made.run()
    assert outcome.status == "completed", outcome.reason
    assert (outcome.pauses.late_steps, outcome.pauses.missed_steps) == (late, missed)
    assert outcome.is_good == (missed == 0)
    assert len(outcome.shortfalls) == (missed > 0)
    creep = [step for step in steps_of(made.rig) if step[0] == "creep"]
    assert len(creep) == kinds
    with h5py.File(made.rig.path) as file:
        exposed_s = file["entry/instrument/on_axis/exposed_s"][()]
        paused = [
            (message.decode(), time_s)
            for message, time_s in zip(
                file["entry/events/message"][()], file["entry/events/time_s"][()], strict=True
            )
        ]
    begins, ends = (
        next(time_s for message, time_s in paused if message.startswith(word))
        for word in ("paused", "goes on")
    )
    assert not np.any((exposed_s > begins) & (exposed_s < ends))
    assert len([message for message, _ in paused if message.startswith("missed: step")]) == missed
    assert len([message for message, _ in paused if " s late, because" in message]) == late
    assert verify_run(made.rig.path).problems == []


def test_a_turn_is_stopped_and_commanded_again(tmp_path):
    made = Paused(tmp_path, "rotate", 190, 50)
    outcome = made.run()
    assert outcome.status == "completed", outcome.reason
    assert outcome.pauses.count == 1
    turns = [call for call in made.rig.calls if call in ("stop", "angle 45", "angle 90")]
    assert turns.count("stop") >= 2
    assert "stop" in turns[: len(turns) - 1]
    assert len([call for call in turns if call != "stop"]) == 3


@pytest.mark.parametrize(
    "name",
    ["creep", "moving", "rotate", *(pytest.param(name, marks=LONGER) for name in ("cycles", "tension"))],
)
def test_a_replay_pauses_where_the_run_was_paused(tmp_path, name):
    whole = Paused(tmp_path, name, 10**6, 1)
    whole.run()
    for number, share in enumerate((0.05, 0.31, 0.5, 0.77, 0.93)):
        whole.rig.path.unlink(missing_ok=True)
        made = Paused(tmp_path, name, max(3, int(share * whole.count)), 30 + 40 * number)
        outcome = made.run()
        assert outcome.status == "completed", outcome.reason
        assert outcome.pauses.count == 1
        replayed = replay_run(made.rig.path, tmp_path / f"new{number}.h5")
        assert (replayed.outcome.status, replayed.differences) == ("completed", [])
        assert replayed.outcome.pauses == outcome.pauses
        identical(made.rig.path, tmp_path / f"new{number}.h5")
        made.rig.path.unlink()


def test_a_pause_whose_end_was_requested_before_the_engine_saw_it_stops_no_motion_for_good(tmp_path):
    made = Paused(tmp_path, "to-load", 2000.0, 0)
    outcome = made.run()
    assert outcome.status == "completed", outcome.reason
    assert outcome.pauses.count == 1
    assert outcome.pauses.duration_s < 3.0


def test_an_abort_ends_a_pause_at_once(tmp_path):
    made = Paused(tmp_path, "to-load", 2000.0, 10**6)
    made.then = (50, lambda: made.engine.abort("the abort button"))
    outcome = made.run()
    assert outcome.status == "aborted"
    assert "the abort button" in outcome.reason
    assert made.count <= made.begins + 53
    assert made.rig.calls.count("load 4000") == 1
    replayed = replay_run(made.rig.path)
    assert (replayed.outcome.status, replayed.differences) == ("aborted", [])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"load_n": 14000.0}, "a load within 13000 N"),
        ({"load_n": 0.0}, "the specimen broke"),
        ({"faults": ("oil temperature",)}, "oil temperature"),
    ],
)
def test_limits_breaks_and_faults_end_a_run_in_a_pause(tmp_path, change, said):
    made = Paused(tmp_path, "to-load", 2000.0, 200)

    def changed(_, state):
        made.note(state)
        return replace(state, **change) if made.count >= made.begins + 50 else state

    made.rig.load_frame.on_read = changed
    outcome = made.run()
    assert outcome.status == "failed"
    assert said in outcome.reason
    assert made.count <= made.begins + 53


def test_a_pause_during_a_question_begins_after_its_answer(tmp_path):
    made = Paused(tmp_path, "to-load", 10**6, 1)
    seen = []

    def act(action):
        if action.name == "REMOVE_GRID":
            made.engine.pause("a test")
            made.rig.clock.sleep(30.0)
            seen.append(made.engine.status.state.name)
            made.stops[made.count + 50] = made.go_on

    made.rig.operator.on_perform = act
    outcome = made.run()
    assert outcome.status == "completed", outcome.reason
    assert seen == ["PREPARING"]
    assert outcome.pauses.count == 1
    first = made.rig.calls.index("load 4000")
    assert "tare" in made.rig.calls[:first]


def test_a_pause_is_refused_before_the_run_and_after_it_and_going_on_needs_a_pause(tmp_path):
    made = Paused(tmp_path, "rotate", 10**6, 1)
    assert "it is idle" in made.engine.pause("a test")
    assert made.engine.go_on("a test") == "the run is not paused"
    assert made.run().pauses == PauseTotals()
    assert "it is completed" in made.engine.pause("a test")


def test_a_run_that_was_paused_and_then_aborted_goes_on_from_its_finished_steps(tmp_path):
    definition = text(HOLD + f"[[phases]]{TO_LOAD}".replace("4000", "6000"), SLOW)
    made = Paused(tmp_path, "creep", reading_in_hold(tmp_path), 150, definition)
    go = made.rig.load_frame.go_to_load

    def refuse(load_n, rate_n_s):
        if load_n == 6000.0:
            made.engine.abort("enough")
        go(load_n, rate_n_s)

    made.rig.load_frame.go_to_load = refuse
    outcome = made.run()
    assert outcome.status == "aborted"
    assert outcome.pauses.missed_steps == 2
    with RunFile(made.rig.path) as run:
        assert [step.index for step in run.steps] == [0, 1, 2, 5]
    earlier = read_earlier(made.rig.path, definition, "")
    assert sorted(earlier.readings) == [0, 1, 2, 3, 4, 5]
    assert (earlier.next.index, earlier.next.target) == (6, 6000.0)


def test_a_pause_by_the_person_at_the_machine_is_ended_only_there(tmp_path):
    made = Paused(tmp_path, "to-load", 2000.0, 100)
    answers = []

    def act():
        made.engine.pause("HTTP")
        made.engine.pause("a person", at_machine=True)
        answers.append(made.engine.go_on("HTTP"))
        answers.append(made.engine.go_on("a person", at_machine=True))

    made.go_on = lambda: None
    made.then = (50, act)
    outcome = made.run()
    assert outcome.status == "completed", outcome.reason
    assert "only the person there can let it go on" in answers[0]
    assert answers[1] == ""
    assert "goes on by a person after" in " ".join(made.rig.events())
