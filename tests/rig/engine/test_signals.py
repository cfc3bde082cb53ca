import signal
import threading
from collections.abc import Callable

import h5py
import pytest

from rig.engine.engine import Engine
from rig.engine.signals import SIGNALS, aborting_on_signals
from rig.engine.status import State


def signalling(engine: Engine, number: signal.Signals = signal.SIGINT) -> Callable[[], None]:
    """Return a function that sends a signal, and returns when the engine's `abort` was called."""
    abort, told = engine.abort, threading.Event()

    def note(reason: str) -> None:
        abort(reason)
        told.set()

    def send() -> None:
        told.clear()
        signal.raise_signal(number)
        assert told.wait(60.0)

    engine.abort = note  # type: ignore[method-assign]
    return send


@pytest.mark.parametrize("number", SIGNALS)
def test_signal_while_moving_aborts_holds_and_closes_the_file(tension, number):
    engine = tension.engine()
    send = signalling(engine, number)

    def kill_in_step_4(count, state):
        status = engine.status
        if status.step and status.step.index == 4 and status.state is State.MOVING:
            send()
        return state

    tension.load_frame.on_read = kill_in_step_4
    before, descriptor = signal.getsignal(number), signal.set_wakeup_fd(-1)
    with aborting_on_signals(engine):
        outcome = engine.run()

    assert signal.getsignal(number) is before
    assert signal.set_wakeup_fd(descriptor) == -1
    assert outcome.status == "aborted"
    assert number.name in outcome.reason
    assert tension.calls[-2:] == ["hold", "hold"]
    with h5py.File(tension.path) as file:
        assert file["entry/status"][()] == b"aborted"
        assert list(file["entry/steps/complete"][()]) == [1, 1, 1, 1]


def test_signal_while_the_operator_is_asked_does_not_wait_for_an_answer(tension):
    answer = threading.Event()
    engine = tension.engine()
    send = signalling(engine)

    def never_answer(action):
        send()
        answer.wait()

    tension.operator.on_perform = never_answer
    with aborting_on_signals(engine):
        outcome = engine.run()
    assert (outcome.status, outcome.lost_devices) == ("aborted", ())
    assert engine.status.state is State.ABORTED
    answer.set()


def test_signal_after_the_end_does_nothing(rotation):
    engine = rotation.engine()
    with aborting_on_signals(engine):
        engine.run()
        signal.raise_signal(signal.SIGINT)
    assert "stop" not in rotation.calls


def test_further_signals_command_the_safe_state_again_and_change_nothing_else(tension):
    engine = tension.engine()
    send = signalling(engine)

    def interrupt_twice(action):
        send()
        send()

    tension.operator.on_perform = interrupt_twice
    with aborting_on_signals(engine):
        outcome = engine.run()
    assert outcome.status == "aborted"
    assert tension.calls.count("ATTACH_GRID") == 1
    assert tension.calls[-1] == "hold"


def test_signal_is_noticed_even_if_the_main_thread_never_returns_to_python(tension):
    """A library that hangs in the main thread must not keep the machine moving: nothing here runs there."""
    engine = tension.engine()
    send = signalling(engine)
    with aborting_on_signals(engine):
        # The thread that gets the signal is this one, and it is not in the interpreter's loop meanwhile.
        blocked = threading.Thread(target=send)
        blocked.start()
        blocked.join()
    assert "SIGINT" in engine.run().reason


def test_other_signals_that_arrive_at_the_same_place_do_nothing(rotation):
    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    try:
        rotation.operator.on_perform = lambda action: signal.raise_signal(signal.SIGUSR1)
        engine = rotation.engine()
        with aborting_on_signals(engine):
            assert engine.run().status == "completed"
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_hangup_that_was_ignored_before_does_not_end_the_run(rotation):
    def hang_up(count, frame):
        signal.raise_signal(signal.SIGHUP)
        return frame

    rotation.cameras["on_axis"].on_grab = hang_up
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        engine = rotation.engine()
        with aborting_on_signals(engine):
            assert engine.run().status == "completed"
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
