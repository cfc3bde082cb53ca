"""The engine reads the machine before it asks the operator, and after the end of a run."""

import math
import threading
from contextlib import contextmanager

import pytest

from drivers.errors import LinkLost
from rig.limit_settings import RigLimits
from tests.rig.conftest import FakeLoadFrame


def test_a_loaded_specimen_is_not_offered_a_grid(tension):
    tension.load_frame.displacement_mm = 0.4
    outcome = tension.engine().run()
    assert outcome.status == "failed"
    expected = "step 0 (grid), before the grid is attached: expected a load within 100 N, got 5"
    assert outcome.reason.startswith(expected)
    assert "rig unload" in outcome.reason
    assert "ATTACH_GRID" not in tension.calls


@pytest.mark.parametrize(
    ("load_n", "limits", "offered"),
    [
        # one per cent of the largest load of the load frame, 15 kN
        (151.0, RigLimits(), False),
        (-151.0, RigLimits(), False),
        (149.0, RigLimits(), True),
        (149.0, RigLimits(unloaded_max_n=100.0), False),
        (400.0, RigLimits(unloaded_max_n=500.0), True),
        (math.nan, RigLimits(), False),
    ],
)
def test_a_rotation_on_a_rig_with_a_load_frame_offers_the_grid_only_without_load(
    rotation, load_n, limits, offered
):
    rotation.load_frame = FakeLoadFrame(rotation.clock, rotation.calls, zero_n=load_n)
    rotation.limits = limits
    outcome = rotation.engine().run()
    assert ("ATTACH_GRID" in rotation.calls) == offered
    assert outcome.status == ("completed" if offered else "failed")
    if not offered:
        assert f"before the grid is attached: expected a load within {limits.unloaded_max_n or 150:g} N" in (
            outcome.reason
        )
        assert "raise limits.unloaded_max_n in the rig file" in outcome.reason
    assert "tare" not in rotation.calls


@pytest.mark.parametrize("ending", ["completed", "failed", "aborted"])
def test_the_outcome_says_what_the_machine_does_after_the_end(tension, ending):
    engine = tension.engine()

    def end(count, frame):
        if count == 5 and ending == "aborted":
            engine.abort("enough")
        if count == 5 and ending == "failed":
            tension.load_frame.load_scale = 9.0
        return frame

    tension.cameras["on_axis"].on_grab = end
    outcome = engine.run()
    assert outcome.status == ending
    state = outcome.at_end.load_frame
    assert (state.holding, state.displacement_mm) == (True, tension.load_frame.displacement_mm)
    assert state.displacement_mm > 0.0
    assert (outcome.at_end.stage, outcome.at_end.silent) == (None, {})


def test_the_outcome_says_where_the_stage_stands(rotation):
    outcome = rotation.engine().run()
    assert outcome.at_end.stage.angle_deg == rotation.stage.angle_deg > 0.0
    assert outcome.at_end.load_frame is None


def test_a_device_that_does_not_answer_after_the_end_is_named(tension):
    def lose(count, state):
        if count >= 60:
            raise LinkLost("load_frame", "read", "an answer", "none", "check the cable")
        return state

    tension.load_frame.on_read = lose
    at_end = tension.engine().run().at_end
    assert at_end.load_frame is None
    assert at_end.silent == {"load_frame": "load_frame: read: expected an answer, got none; check the cable"}


def test_a_question_that_the_end_of_a_run_interrupts_is_withdrawn(tension):
    withdrawn = threading.Event()
    tension.operator.close = withdrawn.set
    engine = tension.engine()

    def wait(action):
        threading.Thread(target=engine.abort, args=("enough",)).start()
        withdrawn.wait(60.0)

    tension.operator.on_perform = wait
    assert engine.run().status == "aborted"
    assert withdrawn.wait(60.0)


def test_questions_are_announced_with_what_the_operator_says_about_them(tension):
    told = []

    @contextmanager
    def announce(action, notice):
        told.append((action.name, notice))
        yield
        told.append(tension.calls[-1])

    tension.operator.notice = lambda action: f"someone will {action.value}"
    assert tension.engine(on_question=announce).run().status == "completed"
    assert told == [
        ("ATTACH_GRID", "someone will attach the calibration grid to the specimen"),
        "ATTACH_GRID",
        ("REMOVE_GRID", "someone will remove the calibration grid"),
        "REMOVE_GRID",
    ]
