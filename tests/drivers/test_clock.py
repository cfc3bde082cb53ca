"""Simulated time passes only while all activities sleep or wait, and their order is always the same."""

import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from drivers.clock import Event, GivenUp, SystemClock, VirtualClock

FOREVER_S = 30.0


class Work:
    """Runs functions on separate threads, each as an activity of a clock."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._pool = ThreadPoolExecutor(50)
        self._done: list = []

    def begin(self, function: Callable[[], object], *, at_once: bool = False) -> None:
        activity = self._clock.activity(at_once=at_once)

        def run() -> object:
            with activity:
                return function()

        self._done.append(self._pool.submit(run))

    def results(self) -> list:
        return [each.result(FOREVER_S) for each in self._done]

    def close(self) -> None:
        self._pool.shutdown()


@pytest.fixture
def work(clock) -> Iterator[Work]:
    made = Work(clock)
    yield made
    made.close()


def times(clock: VirtualClock, period_s: float, count: int) -> list[float]:
    seen = []
    for _ in range(count):
        clock.sleep(period_s)
        seen.append(clock.now_s())
    return seen


def test_without_activities_each_sleep_ends_at_once(clock):
    assert times(clock, 3600.0, 3) == [3600.0, 7200.0, 10800.0]
    assert not clock.wait(Event(), 60.0)
    assert clock.now_s() == 10860.0


def test_work_that_sleeps_side_by_side_sleeps_the_same_time(clock, work):
    with clock.activity():
        work.begin(lambda: times(clock, 3.0, 2))
        work.begin(lambda: times(clock, 2.0, 3))
    assert work.results() == [[3.0, 6.0], [2.0, 4.0, 6.0]]
    assert clock.now_s() == 6.0


def test_time_stands_still_while_work_is_done(clock, work):
    """The first reads the time again and again while the second waits for its turn."""
    go_on = threading.Event()
    seen = []

    def busy() -> None:
        assert go_on.wait(FOREVER_S)
        seen.extend(clock.now_s() for _ in range(1000))

    with clock.activity():
        work.begin(busy)
        work.begin(lambda: clock.sleep(1.0), at_once=True)
    go_on.set()
    work.results()
    assert set(seen) == {0.0}
    assert clock.now_s() == 1.0


def test_work_of_the_same_time_takes_turns_in_the_same_order(clock):
    def order() -> list[int]:
        """Return the order in which fifty threads work, if all of them wake at the same times."""
        clock, seen = VirtualClock(), []
        work = Work(clock)

        def steps(number: int) -> None:
            for _ in range(5):
                seen.append(number)
                clock.sleep(1.0)

        with clock.activity():
            for number in range(50):
                work.begin(lambda number=number: steps(number))
        work.results()
        work.close()
        return seen

    assert order() == list(range(50)) * 5


def test_work_that_must_not_wait_for_its_turn_runs_beside_the_rest(clock, work):
    met = threading.Barrier(2)

    def meet() -> int:
        return met.wait(FOREVER_S)

    with clock.activity():
        work.begin(meet, at_once=True)
        work.begin(meet, at_once=True)
    assert sorted(work.results()) == [0, 1]


def test_event_ends_a_wait_at_its_time_and_not_later(clock, work):
    event = Event()

    def raise_it() -> None:
        clock.sleep(2.5)
        event.set()

    def poll() -> list[float]:
        seen = []
        while not clock.wait(event, 1.0):
            seen.append(clock.now_s())
        return [*seen, clock.now_s()]

    with clock.activity():
        work.begin(poll)
        work.begin(raise_it)
    assert work.results()[0] == [1.0, 2.0, 2.5]
    assert clock.wait(event, 1.0)
    event.clear()
    assert not event.is_set()


def test_event_from_outside_wakes_even_while_other_work_is_busy(clock, work):
    """An abort must not wait until a simulated device has done its work."""
    event, busy, go_on = Event(), threading.Event(), threading.Event()

    def hog() -> None:
        busy.set()
        go_on.wait(FOREVER_S)

    def waiting() -> tuple[bool, float]:
        return clock.wait(event, math.inf), clock.now_s()

    with clock.activity():
        work.begin(waiting)
        work.begin(hog)
    assert busy.wait(FOREVER_S)
    event.set()
    assert work._done[0].result(FOREVER_S) == (True, 0.0)
    go_on.set()
    work.results()


@pytest.mark.parametrize("clock", [VirtualClock(), SystemClock()])
def test_wait_can_be_bounded_by_real_time(clock):
    """Work that hangs lets no simulated time pass: only real time ends the wait for it."""
    with ThreadPoolExecutor() as pool:
        go_on, activity = threading.Event(), clock.activity()

        def hang() -> None:
            with activity:
                go_on.wait(FOREVER_S)

        hanging = pool.submit(hang)
        assert not clock.wait(Event(), math.inf, 0.01)
        go_on.set()
        hanging.result(FOREVER_S)


def test_work_that_is_given_up_is_waited_for_no_longer(clock, work):
    go_on, asleep = threading.Event(), threading.Event()
    activity = clock.activity()

    def hang() -> None:
        with activity:
            asleep.set()
            go_on.wait(FOREVER_S)

    thread = threading.Thread(target=hang)
    thread.start()
    assert asleep.wait(FOREVER_S)
    activity.end()
    activity.end()
    with clock.activity():
        clock.sleep(10.0)
    assert clock.now_s() == 10.0
    go_on.set()
    thread.join(FOREVER_S)
    assert not thread.is_alive()


def test_work_that_is_given_up_while_it_sleeps_moves_no_time_and_ends(clock):
    left = []

    def oversleep() -> None:
        with activity:
            try:
                clock.sleep(1e9)
            except GivenUp:
                left.append("asleep")
            try:
                clock.sleep(1.0)
            except GivenUp:
                left.append("again")

    with clock.activity():
        activity = clock.activity()
        thread = threading.Thread(target=oversleep)
        thread.start()
        clock.sleep(1.0)
        activity.end()
        clock.sleep(4.0)
    assert clock.now_s() == 5.0
    thread.join(FOREVER_S)
    assert left == ["asleep", "again"]


def test_activity_within_an_activity_of_the_same_thread_counts_once(clock, work):
    def nested() -> float:
        with clock.activity(), clock.activity(at_once=True):
            clock.sleep(1.0)
        clock.sleep(1.0)
        return clock.now_s()

    with clock.activity():
        work.begin(nested)
    assert work.results() == [2.0]


def test_thread_without_activity_sleeps_beside_those_that_have_one(clock, work):
    with ThreadPoolExecutor() as pool, clock.activity():
        other = pool.submit(times, clock, 4.0, 1)
        assert times(clock, 3.0, 4)[-1] == 12.0
    assert other.result(FOREVER_S)[0] >= 4.0


def test_machines_own_time_is_waited_for(clock):
    event = Event()
    event.set()
    assert SystemClock().wait(event, math.inf)
    event.clear()
    assert not SystemClock().wait(event, 0.0)
    with SystemClock().activity(at_once=True) as activity:
        assert activity is None
