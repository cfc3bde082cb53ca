import threading

import pytest

from rig.devices import Rig
from rig.engine.safety import SafeState


@pytest.fixture
def both(tension, rotation) -> Rig:
    """A rig with a load frame and a stage; each of the two has its own list of calls."""
    return Rig(tension.clock, tension.operator, tension.cameras, rotation.stage, tension.load_frame)


@pytest.fixture
def never():
    """A command that does not return before the end of the test."""
    over = threading.Event()
    yield over.wait
    over.set()


def test_both_devices_are_made_safe(both, tension, rotation):
    assert SafeState(both).confirm() == []
    assert (tension.calls, rotation.calls) == (["hold"], ["stop"])


def test_frame_that_never_answers_neither_keeps_the_stage_turning_nor_the_run_from_ending(
    both, tension, rotation, never
):
    tension.load_frame.on_hold = never
    assert SafeState(both, deadline_s=0.05).confirm() == ["load_frame: no confirmation within 0.05 s"]
    assert rotation.calls == ["stop"]


def test_stage_is_stopped_while_the_frame_is_still_being_asked(both, tension, rotation):
    stopped = threading.Event()
    rotation.stage.stop = stopped.set
    held = []
    tension.load_frame.on_hold = lambda: held.append(stopped.wait(60.0))
    assert SafeState(both).confirm() == []
    assert held == [True]


def test_repeated_command_does_not_pile_up_on_a_device_that_is_silent(both, tension, rotation, never):
    tension.load_frame.on_hold = never
    state = SafeState(both, deadline_s=0.05)
    for _ in range(5):
        state.command()
    assert tension.calls == ["hold"]
    assert state.confirm() != []
    assert tension.calls == ["hold", "hold"]


def test_safe_state_needs_no_threads_when_there_are_none(both, tension, rotation, monkeypatch):
    def refuse(thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    assert SafeState(both).confirm() == []
    assert (tension.calls, rotation.calls) == (["hold"], ["stop"])


def test_driver_that_exits_does_not_leave_the_other_device_moving(both, tension, rotation):
    def leave():
        raise SystemExit("a driver gives up")

    tension.load_frame.on_hold = leave
    assert SafeState(both).confirm() == ["a driver gives up"]
    assert rotation.calls == ["stop"]


def test_both_devices_are_commanded_before_anything_else_is_done(both, tension, rotation):
    commanded = [threading.Event(), threading.Event()]
    tension.load_frame.on_hold, rotation.stage.stop = (event.set for event in commanded)
    seen = []
    SafeState(both).confirm(meanwhile=lambda: seen.extend(event.wait(60.0) for event in commanded))
    assert seen == [True, True]
