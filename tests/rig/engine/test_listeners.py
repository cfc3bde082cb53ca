"""The listeners of a run get the right reports, and no listener can harm the run."""

import threading

import h5py
import pytest

from drivers.errors import DeviceTimeout
from rig.engine.status import State
from rig.errors import RecordingError
from rig.recorder import Recorder


def failing(at: State, error: BaseException):
    """Return a listener that raises an error in the state `at`, and the list of its received states."""
    told = []

    def listener(status) -> None:
        told.append(status.state)
        if status.state is at:
            raise error

    return listener, told


def mute_camera(count, frame):
    raise DeviceTimeout("cameras.on_axis", "grab", "an image", "none", "check the cable")


def test_all_listeners_are_told_the_same_in_the_same_order(rotation):
    told = [[], [], []]
    steps = [[], []]
    outcome = rotation.engine(
        on_status=[one.append for one in told], on_step=[one.append for one in steps]
    ).run()
    assert outcome.lost_listeners == ()
    assert told[0] == told[1] == told[2]
    assert told[0][-1].state is State.COMPLETED
    assert steps[0] == steps[1]
    assert len(steps[0]) == outcome.steps_done


def test_listener_that_raises_hurts_neither_the_run_nor_the_others(tension):
    listener, told = failing(State.MOVING, ZeroDivisionError("a bug"))
    others = []
    outcome = tension.engine(on_status=[listener, others.append]).run()
    assert outcome.status == "completed"
    assert told[-1] is State.MOVING
    assert told.count(State.MOVING) == 1
    assert others[-1].state is State.COMPLETED
    (lost,) = outcome.lost_listeners
    assert "ZeroDivisionError: a bug; it is not called again" in lost
    assert tension.events().count(lost) == 1


def test_listener_to_steps_that_raises_is_told_no_more(rotation):
    told = []

    def explode(record) -> None:
        told.append(record)
        raise DeviceTimeout("display", "show", "an answer", "none", "look at it")

    outcome = rotation.engine(on_step=[explode]).run()
    assert (outcome.status, len(told)) == ("completed", 1)
    assert "explode: DeviceTimeout: display: show: expected an answer" in outcome.lost_listeners[0]


@pytest.mark.parametrize("error", [ZeroDivisionError("a bug"), KeyboardInterrupt()])
@pytest.mark.parametrize("at", [State.SAFING, State.FAILED])
def test_listener_that_raises_at_the_end_does_not_keep_the_rig_from_being_made_safe(tension, at, error):
    tension.cameras["on_axis"].on_grab = mute_camera
    listener, told = failing(at, error)
    engine = tension.engine(on_status=[listener])
    outcome = engine.run()
    assert told[-1] is at
    assert (outcome.status, outcome.unsafe, engine.status.state) == ("failed", (), State.FAILED)
    assert tension.calls[-1] == "hold"
    assert len(outcome.lost_listeners) == 1
    with h5py.File(tension.path) as file:
        assert file["entry/status"][()] == b"failed"


def test_listener_that_raises_once_the_file_is_closed_is_told_of_in_the_outcome(tension):
    listener, _ = failing(State.COMPLETED, ZeroDivisionError("a bug"))
    outcome = tension.engine(on_status=[listener]).run()
    assert outcome.status == "completed"
    assert "ZeroDivisionError: a bug" in outcome.lost_listeners[0]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(3)])
def test_listener_that_asks_for_the_end_of_the_program_ends_the_run_safely(rotation, error):
    listener, _ = failing(State.PREPARING, error)
    asked = threading.Event()
    rotation.operator.on_perform = lambda action: asked.wait(60.0)
    engine = rotation.engine(on_status=[listener])
    abort = engine.abort

    def note(reason: str) -> None:
        abort(reason)
        asked.set()

    engine._news._on_status[1]._end_run = note
    outcome = engine.run()
    assert outcome.status == "aborted"
    assert f"listener failing.<locals>.listener: {type(error).__name__}" in outcome.reason
    assert rotation.calls[-1] == "stop"


def test_devices_are_told_to_stop_before_the_listeners_are_told_so(rotation):
    stopped, seen = threading.Event(), []
    rotation.cameras["on_axis"].on_grab = mute_camera
    rotation.stage.stop = stopped.set

    def listener(status) -> None:
        if status.state is State.SAFING:
            seen.append(stopped.wait(60.0))

    rotation.engine(on_status=[listener]).run()
    assert seen == [True]


def test_file_that_takes_no_event_of_a_lost_listener_fails_the_run(tension, monkeypatch):
    def full(recorder, time_s, level, source, message):
        if level == "warning":
            raise RecordingError("run.h5", "recording an event to succeed", "no space", "make room")

    monkeypatch.setattr(Recorder, "event", full)
    listener, _ = failing(State.MOVING, ZeroDivisionError("a bug"))
    outcome = tension.engine(on_status=[listener]).run()
    assert outcome.status == "failed"
    assert "no space" in outcome.reason
    assert tension.calls[-1] == "hold"
