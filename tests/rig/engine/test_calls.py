"""A driver's call that hangs is given up at its deadline, and until then the other devices are watched."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from itertools import count, pairwise

import pytest

from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from rig.engine.calls import NEVER, PATIENCE_S, Calls, Deadline
from rig.errors import Aborted
from rig.threads import waited_for_processor_s

SHORT = Deadline(0.05, "look at it")
LONG = Deadline(60.0)


@pytest.fixture
def hang() -> Iterator[Callable[[], None]]:
    """A driver's call that does not return before the end of the test."""
    over = threading.Event()
    yield lambda: over.wait() and None
    over.set()


@pytest.fixture(params=[SystemClock, VirtualClock])
def calls(request) -> Iterator[Calls]:
    made = Calls(request.param(), lambda: None)
    yield made
    made.close()


def test_call_returns_what_the_driver_returns_and_raises_what_it_raises(calls):
    def fail() -> None:
        raise ZeroDivisionError("a driver with a bug")

    assert calls.do("stage", "read", lambda: 42, LONG) == 42
    with pytest.raises(DeviceFault, match=r"raises ZeroDivisionError \(a driver with a bug\); mend"):
        calls.do("stage", "read", fail, LONG)
    assert calls.do("stage", "read", lambda: 43, LONG) == 43


def test_calls_of_a_device_are_made_in_order_on_one_thread_that_is_not_the_engines(calls):
    threads, order = set(), []

    def note(number: int) -> None:
        threads.add(threading.get_ident())
        order.append(number)

    begun = [calls.begin("stage", "read", lambda number=number: note(number), LONG) for number in range(20)]
    for call in begun:
        calls.finish(call)
    assert order == list(range(20))
    assert len(threads) == 1
    assert threading.get_ident() not in threads


def test_simulated_call_may_wait_for_another_one_of_its_device(clock):
    """The second call must not stop simulated time while its thread sleeps in the first one."""
    calls = Calls(clock, lambda: None, patience_s=0.5)
    with clock.activity():
        first = calls.begin("camera", "take frames", lambda: clock.sleep(0.25), LONG)
        second = calls.begin("camera", "close", clock.now_s, LONG)
        assert calls.finish(second) == pytest.approx(0.25)
        assert first.done
        assert calls.idle("camera")
    calls.close()


def test_calls_of_different_devices_do_not_wait_for_each_other(hang):
    calls = Calls(SystemClock(), lambda: None)
    hanging = calls.begin("stage", "read", hang, LONG)
    assert calls.do("load_frame", "read", lambda: "a reading", LONG) == "a reading"
    assert not hanging.done


def test_call_that_hangs_is_given_up_at_its_deadline_and_its_device_is_lost(hang):
    lost = {}
    calls = Calls(SystemClock(), lambda: None, lost)
    with pytest.raises(DeviceTimeout) as error:
        calls.do("stage", "read", hang, SHORT)
    assert str(error.value) == (
        "stage: read: expected the end of the call within 0.05 s, got none: the call hangs; look at it"
    )
    assert lost == {"stage": "read, which has not returned for 0.05 s"}
    with pytest.raises(
        LinkLost, match="stage: home: expected a device that answers, got read, which has not"
    ):
        calls.do("stage", "home", lambda: None, LONG)
    assert calls.do("load_frame", "read", lambda: 1, LONG) == 1


def test_simulated_call_that_sleeps_beyond_its_deadline_is_given_up_in_simulated_time():
    clock = VirtualClock()
    calls = Calls(clock, lambda: None)
    with clock.activity():
        with pytest.raises(DeviceTimeout):
            calls.do("stage", "read", lambda: clock.sleep(3600.0), Deadline(0.7))
        assert clock.now_s() == pytest.approx(0.7)


def test_simulated_device_may_compute_for_longer_than_its_deadline():
    """Simulated time stands still meanwhile: only a true hang takes `PATIENCE_S` of real time."""
    clock, go_on = VirtualClock(), threading.Event()
    calls = Calls(clock, lambda: None)
    with clock.activity():
        call = calls.begin("cameras.left", "grab", lambda: go_on.wait(PATIENCE_S), Deadline(0.001))
        threading.Timer(0.05, go_on.set).start()
        assert calls.finish(call)
        assert clock.now_s() == 0.0


def test_calls_behind_one_that_was_given_up_let_time_pass():
    clock = VirtualClock()
    calls = Calls(clock, lambda: None)
    with clock.activity():
        hanging = calls.begin("stage", "read", lambda: clock.sleep(3600.0), Deadline(0.7))
        behind = calls.begin("stage", "stop", lambda: clock.sleep(3600.0), Deadline(0.7))
        for call in (hanging, behind):
            with pytest.raises(DeviceTimeout):
                calls.finish(call)
        clock.sleep(10.0)
        assert clock.now_s() < 20.0
    calls.close()


def test_simulated_device_that_computes_on_a_busy_computer_does_not_hang(monkeypatch):
    """It takes longer than the patience, and the processor time shows that it computes."""
    clock, finished, patience_s, asked = VirtualClock(), threading.Event(), 0.2, []

    def processor_s() -> float:
        asked.append(patience_s)
        if len(asked) == 3:
            finished.set()
        return 0.1 * sum(asked)

    monkeypatch.setattr("rig.engine.calls.process_time", processor_s)
    calls = Calls(clock, lambda: None, patience_s=patience_s)
    with clock.activity():
        call = calls.begin("cameras.left", "grab", lambda: finished.wait(60.0), Deadline(0.001))
        assert calls.finish(call)


@pytest.mark.parametrize("share", [0.0, 0.4], ids=["waits", "computes"])
def test_simulated_device_that_hangs_is_given_up_even_if_it_computes(share, hang, monkeypatch):
    used_s = count(step=share * 0.05)
    monkeypatch.setattr("rig.engine.calls.process_time", lambda: next(used_s))
    clock = VirtualClock()
    calls = Calls(clock, lambda: None, patience_s=0.05)
    with clock.activity():
        call = calls.begin("cameras.left", "grab", hang, Deadline(0.001))
        with pytest.raises(DeviceTimeout, match="the call hangs"):
            calls.finish(call)


def test_call_that_got_no_processor_is_not_blamed_on_its_device(hang, monkeypatch):
    waited_s = count(step=0.05)
    monkeypatch.setattr("rig.engine.calls.waited_for_processor_s", lambda thread: next(waited_s))
    calls = Calls(SystemClock(), lambda: None, patience_s=0.0)
    call = calls.begin("cameras.left", "grab", hang, Deadline(0.05))
    with pytest.raises(DeviceTimeout, match=r"the computer let it wait .* s for a processor; end other"):
        calls.finish(call)


def test_time_without_a_processor_is_that_of_the_system():
    assert 0.0 <= waited_for_processor_s(threading.get_native_id()) < 1e6
    assert waited_for_processor_s(0) == 0.0


@pytest.mark.parametrize("clock", [SystemClock(), VirtualClock()])
def test_devices_are_watched_while_another_takes_its_time(clock):
    polls, enough = [], threading.Event()

    def take_time() -> str:
        while not enough.is_set():
            clock.sleep(0.001)
        return "an image"

    def poll() -> None:
        polls.append(calls.do("load_frame", "read", clock.now_s, LONG))
        if len(polls) == 10:
            enough.set()

    calls = Calls(clock, lambda: None, meanwhile=poll, every_s=0.01)
    with clock.activity():
        call = calls.begin("cameras.left", "grab", take_time, LONG)
        assert calls.finish(call, watched=True) == "an image"
    assert len(polls) >= 10
    assert all(b - a >= 0.01 - 1e-6 for a, b in pairwise(polls))


def test_what_the_watch_raises_ends_the_wait_at_once(hang):
    def exceed() -> None:
        raise ZeroDivisionError("beyond a limit")

    calls = Calls(SystemClock(), lambda: None, meanwhile=exceed, every_s=0.001)
    call = calls.begin("operator", "attach the grid", hang, NEVER)
    with pytest.raises(ZeroDivisionError):
        calls.finish(call, watched=True)


@pytest.mark.parametrize("clock", [SystemClock(), VirtualClock()])
def test_abort_ends_a_wait_that_has_no_deadline(clock, hang):
    aborted, asked = threading.Event(), threading.Event()

    def check() -> None:
        if aborted.is_set():
            raise Aborted("step 0", "the run to go on", "SIGTERM", "nothing is lost")

    def abort() -> None:
        assert asked.wait(60.0)
        aborted.set()
        calls.interrupt()

    def ask() -> None:
        asked.set()
        hang()

    calls = Calls(clock, check)
    threading.Thread(target=abort).start()
    with clock.activity():
        call = calls.begin("operator", "attach the grid", ask, NEVER)
        with pytest.raises(Aborted):
            calls.finish(call, watched=True)
        with pytest.raises(Aborted):
            calls.pause(3600.0)
        calls.close()
    assert calls.lost == {}


def test_call_that_was_not_begun_when_the_wait_ended_is_never_begun(hang):
    made, held = [], threading.Event()

    def give_up() -> None:
        raise Aborted("step 0", "the run to go on", "SIGTERM", "nothing is lost")

    calls = Calls(SystemClock(), lambda: None, meanwhile=give_up, every_s=0.0)
    first = calls.begin("operator", "wait", lambda: held.wait(60.0), NEVER)
    second = calls.begin("operator", "attach the grid", lambda: made.append(1), NEVER)
    with pytest.raises(Aborted):
        calls.finish(second, watched=True)
    held.set()
    assert calls.finish(first)
    calls.close()
    assert made == []


@pytest.mark.parametrize("clock", [SystemClock(), VirtualClock()])
def test_what_was_begun_elsewhere_is_waited_for_in_the_same_way(clock):
    calls, written = Calls(clock, lambda: None, every_s=0.001), Future()
    with clock.activity():
        call = calls.follow(written, "run file", "write step 1", LONG)
        threading.Timer(0.02, written.set_result, ["on the disk"]).start()
        assert calls.finish(call, watched=True) == "on the disk"
        failed = Future()
        failed.set_exception(OSError("no space"))
        with pytest.raises(OSError, match="no space"):
            calls.finish(calls.follow(failed, "run file", "write step 2", LONG))
    assert isinstance(clock, SystemClock) or clock.now_s() == 0.0


def test_device_whose_call_still_runs_at_the_end_is_lost_too(hang):
    calls = Calls(SystemClock(), lambda: None)
    calls.begin("cameras.left", "grab", hang, LONG)
    calls.close()
    assert calls.lost == {"cameras.left": "grab, which has not returned at the end of the run"}
