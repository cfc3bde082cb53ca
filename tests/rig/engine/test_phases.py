"""Runs with phases on simple simulated devices: long holds, cycles, images during a motion, and breaks."""

import tomllib
from dataclasses import replace
from itertools import pairwise

import h5py
import numpy as np
import pytest

from rig.engine.motion import RunMotion
from rig.protocol.protocol import parse_protocol
from tests.places import example
from tests.rig.conftest import FakeRig
from tests.rig.protocol.test_phases import CYCLES, HOLD, MOVING, PULLING, text

SLOW = PULLING.replace("timeout_s = 60.0", "timeout_s = 60.0\npoll_s = 1.0")


@pytest.fixture
def rig(tmp_path):
    def make(phases: str, tables: str = SLOW) -> FakeRig:
        return FakeRig(parse_protocol(tomllib.loads(text(phases, tables))), tmp_path / "run.h5")

    return make


def steps_of(rig: FakeRig) -> list[tuple[str, float, float, int]]:
    with h5py.File(rig.path) as file:
        steps = file["entry/steps"]
        kinds = [kind.decode() for kind in steps["kind"][()]]
        columns = [steps[name][()] for name in ("target", "time_s", "count_on_axis")]
        return list(zip(kinds, *columns, strict=True))


def readings_of(rig: FakeRig) -> dict[str, np.ndarray]:
    with h5py.File(rig.path) as file:
        return {
            name: column[()]
            for name, column in file["entry/instrument/load_frame"].items()
            if name != "settings"
        }


@pytest.mark.extended
def test_the_creep_example_runs_for_three_hours_of_simulated_time(tmp_path):
    made = FakeRig(parse_protocol(tomllib.loads(example("creep"))), tmp_path / "run.h5")
    outcome = made.engine().run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    steps = steps_of(made)
    assert [kind for kind, *_ in steps] == [
        "grid", "reference", *["load"] * 4, *["creep"] * 12, "load", *["creep"] * 6
    ]  # fmt: skip
    creep_s = [time_s for kind, target, time_s, _ in steps if kind == "creep" and target == 4000.0]
    assert [b - a for a, b in pairwise(creep_s)] == pytest.approx([600.0] * 11, abs=1.01)
    assert creep_s[-1] - creep_s[0] == pytest.approx(6600.0, abs=1.01)
    assert made.clock.now_s() > 3 * 3600.0
    # what was written, told by the reader of the file: the reference is under the preload
    assert steps[1][1] == 200.0
    assert all(count == 1 for *_, count in steps)


def test_a_load_that_drifts_in_creep_is_corrected(rig):
    made = rig(HOLD)
    frame = made.load_frame
    creep_mm = 0.0

    def creeping(count, state):
        nonlocal creep_mm
        if frame.calls[-2:] == ["at 50", "load 4000"] and not state.moving:
            creep_mm += 1.0
        return replace(state, load_n=state.load_n - creep_mm)

    go = frame.go_to_load

    def corrected(load_n, rate_n_s):
        nonlocal creep_mm
        creep_mm = 0.0
        frame.calls.append(f"at {rate_n_s:g}")
        go(load_n, rate_n_s)

    frame.on_read = creeping
    frame.go_to_load = corrected
    assert made.engine().run().status == "completed"
    # the approach, the begin of the hold, and a correction about every 20 s
    assert made.calls.count("load 4000") in (6, 7)
    assert made.calls.count("at 50") == made.calls.count("load 4000") - 1
    loads_n = readings_of(made)["load_n"][-90:]
    assert np.abs(loads_n - 4000.0).max() <= 21.5


def test_a_load_that_cannot_be_kept_fails_the_run(rig, on_frame_state):
    made = rig(HOLD)
    frame = made.load_frame
    frame.on_read = lambda count, state: replace(state, load_n=3900.0) if made.clock.now_s() > 60.0 else state
    outcome = made.engine().run()
    assert outcome.status == "failed"
    assert "(creep 4000 N after 100 s), holding: expected 4000 ± 20, got 3900 for 60 s" in outcome.reason


def test_slow_relaxation_is_no_break_and_a_sudden_drop_is(rig):
    phases = HOLD.replace('keep = "load"\nrate_n_s = 50.0', 'keep = "displacement"')
    for sudden in (False, True):
        made = rig(phases)
        made.path.unlink(missing_ok=True)
        start_s = 30.0

        def relaxing(count, state, sudden=sudden, made=made, start_s=start_s):
            past_s = made.clock.now_s() - start_s
            factor = 1.0 if past_s < 0.0 else max(0.2, 1.0 - past_s / 100.0)
            return replace(state, load_n=state.load_n * (0.1 if sudden and past_s > 50.0 else factor))

        made.load_frame.on_read = relaxing
        outcome = made.engine().run()
        assert outcome.status == ("failed" if sudden else "completed"), outcome.reason
        assert ("the specimen broke" in outcome.reason) is sudden
        assert "hold" in made.calls


def test_unloading_in_cycles_is_no_break_but_a_drop_while_pulling_is(rig):
    made = rig(CYCLES)
    assert made.engine().run().status == "completed"
    # 2 steps of each of 4 imaged cycles, the grid and the reference
    assert len(steps_of(made)) == 10
    assert [call for call in made.calls if call.startswith("load")] == ["load 4000", "load 500"] * 5
    assert made.load_frame.calls[-1] == "hold"

    again = rig(CYCLES)
    again.path = again.path.with_name("torn.h5")

    def tearing(count, state):
        pulled = len([call for call in again.calls if call == "load 4000"])
        return replace(state, load_n=0.1 * state.load_n) if pulled > 2 and state.load_n > 3000.0 else state

    again.load_frame.on_read = tearing
    outcome = again.engine().run()
    assert "the specimen broke" in outcome.reason


def test_images_are_taken_while_the_crosshead_moves(rig):
    made = rig(MOVING)
    assert made.engine().run().status == "completed"
    ways = [call for call in made.calls if call.startswith("displacement")]
    assert ways == ["displacement 1.000000"]
    steps = [step for step in steps_of(made) if step[0] == "displacement"]
    assert len(steps) == 4
    with h5py.File(made.path) as file:
        ways_mm = file["entry/steps/displacement_mm"][2:]
    assert ways_mm[:3] == pytest.approx([0.3, 0.6, 0.9], abs=0.011)
    assert ways_mm[3] == pytest.approx(1.0, abs=0.002)


def test_a_motion_that_an_event_ends_is_stopped_before_the_next_phase(rig):
    phases = MOVING + 'until.load_drop = 0.2\n[[phases]]\ndo = "unload"\nrate_n_s = 500.0\n'
    made = rig(phases)

    def necking(count, state):
        return replace(state, load_n=0.75 * state.load_n) if state.displacement_mm > 0.7 else state

    made.load_frame.on_read = necking
    outcome = made.engine().run()
    assert outcome.status == "completed", outcome.reason
    begun = made.calls.index("displacement 1.000000")
    assert made.calls[begun + 1 : begun + 3] == ["hold", "load 0"]
    assert len([step for step in steps_of(made) if step[0] == "displacement"]) == 3


def test_a_load_and_a_turn_can_be_phases_of_one_test(rig):
    phases = """
[[phases]]
do = "to-load"
load_n = 1000.0
rate_n_s = 200.0
[[phases]]
do = "rotate"
angle_deg = 10.0
images.every_deg = 5.0
[[phases]]
do = "hold"
keep = "angle"
duration_s = 30.0
"""
    made = rig(phases, SLOW.replace("dwell_s", "angle_tolerance_deg = 0.01\ndwell_s"))
    assert made.engine().run().status == "completed"
    assert made.calls[:2] == ["home", "angle 0"]
    assert [kind for kind, *_ in steps_of(made)][2:] == ["load", "rotation", "rotation", "rest"]


def test_the_images_of_a_step_may_stream_in_while_the_machine_moves(rig, monkeypatch):
    made, moments = rig(MOVING), RunMotion.moments

    def streamed(motion, step):
        for reading in moments(motion, step):
            yield reading
            while step.timed and reading.time_s < motion._begun_s + step.at_s + 1.0:
                reading = motion._run.read()
                yield reading

    monkeypatch.setattr(RunMotion, "moments", streamed)
    outcome = made.engine().run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    counts = [count for kind, _, _, count in steps_of(made) if kind == "displacement"]
    assert counts[-1] == 1
    assert all(count > 20 for count in counts[:-1])
    with h5py.File(made.path) as file:
        rows = file["entry/steps/frames_on_axis"][()]
        exposed_s = file["entry/instrument/on_axis/exposed_s"][()]
    assert [len(rows), len(exposed_s)] == [len(counts) + 2, sum(counts) + 2]
    assert np.all(np.diff(exposed_s) > 0.0)
    readings, streamed_s = readings_of(made), exposed_s[rows[2] : rows[3]]
    assert np.all(np.diff(np.interp(streamed_s, readings["time_s"], readings["displacement_mm"])) > 0.0)
