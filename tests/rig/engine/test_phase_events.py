"""The event that ends a phase is noticed at a reading. A replay and a continued run give the same result."""

import tomllib
from dataclasses import replace

import h5py
import pytest

from rig.engine.engine import Engine
from rig.protocol.protocol import parse_protocol
from rig.replay.replay import replay_run
from rig.resume import ContinueError, read_earlier, require_unchanged
from tests.rig.conftest import FakeRig
from tests.rig.engine.test_phases import SLOW, steps_of
from tests.rig.protocol.test_phases import CYCLES, MOVING, text

DROP_MM = 0.7
UNLOAD = '[[phases]]\ndo = "unload"\nrate_n_s = 500.0\n'
DROPPING = MOVING + "until.load_drop = 0.2\n" + UNLOAD


def fake(tmp_path, phases: str) -> FakeRig:
    definition = text(phases, SLOW)
    return FakeRig(parse_protocol(tomllib.loads(definition)), tmp_path / "run.h5", definition=definition)


def tear(rig: FakeRig) -> None:
    """Reduce the load readings by a quarter at displacements above `DROP_MM`."""

    def torn(count, state):
        return replace(state, load_n=0.75 * state.load_n) if state.displacement_mm > DROP_MM else state

    rig.load_frame.on_read = torn


def displacements_mm(rig: FakeRig) -> list[float]:
    with h5py.File(rig.path) as file:
        steps = file["entry/steps"]
        kinds = [kind.decode() for kind in steps["kind"][()]]
        ways = steps["displacement_mm"][()]
        return [way for kind, way in zip(kinds, ways, strict=True) if kind == "displacement"]


@pytest.mark.parametrize(
    ("images", "count"), [("every_s = 30.0", 3), ("every_mm = 0.25", 3), ("never = true", 0)]
)
def test_a_drop_between_two_images_ends_the_motion_at_once(tmp_path, images, count):
    rig = fake(tmp_path, DROPPING.replace("every_s = 30.0", images))
    tear(rig)
    outcome = rig.engine().run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    commands = [call for call in rig.calls if call.startswith(("displacement", "load", "hold"))]
    assert commands[-3:] == ["hold", "load 0", "hold"]
    with h5py.File(rig.path) as file:
        farthest_mm = file["entry/instrument/load_frame/displacement_mm"][()].max()
    # two readings, of which one is a second after the other, at 0.01 mm/s
    assert farthest_mm == pytest.approx(DROP_MM, abs=0.021)
    found = displacements_mm(rig)
    assert len(found) == count
    if found:
        assert found[-1] == pytest.approx(farthest_mm)


def test_noise_before_the_specimen_carries_a_load_ends_no_phase(tmp_path):
    rig = fake(tmp_path, DROPPING + MOVING.replace("1.0", "2.0"))
    rig.load_frame.on_read = lambda count, state: replace(state, load_n=state.load_n + 5.0 * (-1) ** count)
    outcome = rig.engine().run()
    assert "expected a drop of the load by 0.2" in outcome.reason


def test_a_tear_in_a_cycle_without_images_ends_the_cycles(tmp_path):
    rig = fake(tmp_path, CYCLES.replace("count = 5", "count = 9\nuntil.load_drop = 0.2") + UNLOAD)

    is_torn = False

    def torn(count, state):
        nonlocal is_torn
        is_torn = is_torn or (rig.calls.count("load 4000") == 5 and state.load_n > 3000.0)
        return replace(state, load_n=0.75 * state.load_n) if is_torn else state

    rig.load_frame.on_read = torn
    outcome = rig.engine().run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert rig.calls.count("load 4000") == 5
    last = len(rig.calls) - 1 - rig.calls[::-1].index("load 4000")
    assert rig.calls[last + 1 : last + 3] == ["hold", "load 0"]


@pytest.mark.parametrize(
    "images", [pytest.param("every_s = 30.0", marks=pytest.mark.extended), "every_mm = 0.25", "never = true"]
)
def test_a_replay_of_an_event_is_identical(tmp_path, images):
    rig = fake(tmp_path, DROPPING.replace("every_s = 30.0", images))
    tear(rig)
    assert rig.engine().run().status == "completed"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert (replayed.outcome.status, replayed.differences) == ("completed", [])


def continued(rig: FakeRig) -> Engine:
    earlier = read_earlier(rig.path, rig.definition, "")
    rig.path = rig.path.with_name("run-2.h5")
    rig.calls.clear()
    engine = rig.engine(earlier=earlier.readings)
    require_unchanged(earlier, rig.protocol, engine.context.rig)
    return engine


def aborted(rig: FakeRig, when) -> None:
    """Execute the run, and abort it at the first reading of the load frame at which `when` is true."""
    engine, on_read = rig.engine(), rig.load_frame.on_read

    def abort(count, state):
        # Abort here, while the engine waits for the reading, because a listener would be called later.
        if engine.status.step is not None and when(engine.status):
            engine.abort("the abort button")
        return on_read(count, state)

    rig.load_frame.on_read = abort
    assert engine.run().status == "aborted"
    rig.load_frame.on_read = on_read


@pytest.mark.parametrize("images", ["every_s = 30.0", "never = true"])
def test_a_run_that_goes_on_after_an_event_pulls_no_more(tmp_path, images):
    rig = fake(tmp_path, DROPPING.replace("every_s = 30.0", images))
    tear(rig)
    aborted(rig, lambda status: status.step.kind == "load")
    outcome = continued(rig).run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert not [call for call in rig.calls if call.startswith("displacement")]
    assert "load 0" in rig.calls


@pytest.mark.extended
def test_cycles_without_images_go_on_where_they_ended(tmp_path):
    rig = fake(tmp_path, CYCLES.replace("count = 5", "count = 12").replace("= 2\n", "= 10\n"))
    # Steps 2 and 3 are the first cycle, so step 13 is the end of the sixth, without images.
    aborted(rig, lambda status: status.step.index == 13)
    before = rig.calls.count("load 4000")
    assert before >= 6
    outcome = continued(rig).run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert before + rig.calls.count("load 4000") in (12, 13)
    assert steps_of(rig)[-1][1] == 500.0


def test_cycles_without_images_in_a_file_of_an_earlier_version_are_refused(tmp_path, monkeypatch):
    rig = fake(tmp_path, CYCLES.replace("count = 5", "count = 6").replace("= 2\n", "= 5\n"))
    aborted(rig, lambda status: status.step.index == 12)
    monkeypatch.setattr("rig.resume.STEP_REACHED", "not in the file")
    with pytest.raises(ContinueError, match="cycles without images, whose readings are not known"):
        continued(rig)
