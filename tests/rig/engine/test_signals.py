import signal

import h5py
import pytest

from rig.engine.signals import SIGNALS, aborting_on_signals
from rig.engine.status import State


@pytest.mark.parametrize("number", SIGNALS)
def test_signal_while_moving_aborts_holds_and_closes_the_file(tension, number):
    def kill_in_step_4(status):
        if status.step and status.step.index == 4 and status.state is State.MOVING and status.reading:
            signal.raise_signal(number)

    engine = tension.engine(on_status=[kill_in_step_4])
    before = signal.getsignal(number)
    with aborting_on_signals(engine):
        outcome = engine.run()

    assert signal.getsignal(number) is before
    assert outcome.status == "aborted"
    assert number.name in outcome.reason
    assert tension.calls[-2:] == ["hold", "hold"]
    with h5py.File(tension.path) as file:
        assert file["entry/status"][()] == b"aborted"
        assert list(file["entry/steps/complete"][()]) == [1, 1, 1, 1]


def test_signal_while_the_operator_is_asked_does_not_wait_for_an_answer(tension):
    answered = []

    def never_answer(action):
        signal.raise_signal(signal.SIGINT)
        answered.append(action)

    tension.operator.on_perform = never_answer
    engine = tension.engine()
    with aborting_on_signals(engine):
        outcome = engine.run()
    assert outcome.status == "aborted"
    assert answered == []
    assert engine.status.state is State.ABORTED


def test_signal_after_the_end_does_nothing(rotation):
    engine = rotation.engine()
    with aborting_on_signals(engine):
        engine.run()
        signal.raise_signal(signal.SIGINT)
    assert "stop" not in rotation.calls


def test_second_signal_never_breaks_into_the_safe_state(tension):
    def interrupt_twice(action):
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            # What a second one would meet that comes before the first has left the operator.
            signal.raise_signal(signal.SIGINT)
            tension.calls.append("the first goes on")

    tension.operator.on_perform = interrupt_twice
    engine = tension.engine()
    with aborting_on_signals(engine):
        outcome = engine.run()
    assert outcome.status == "aborted"
    assert "the first goes on" in tension.calls
    assert tension.calls[-1] == "hold"


def test_hangup_that_was_ignored_before_does_not_end_the_run(rotation):
    def hang_up(status):
        if status.state is State.MOVING:
            signal.raise_signal(signal.SIGHUP)

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        engine = rotation.engine(on_status=[hang_up])
        with aborting_on_signals(engine):
            assert engine.run().status == "completed"
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
