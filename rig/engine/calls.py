"""Calls of drivers. Each call runs on the thread of its device, with a deadline, while the engine continues.

A driver may come from another package, and any call of a driver may hang. The engine's thread therefore never
calls a driver itself.
"""

import math
import queue
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock, get_native_id
from time import process_time
from typing import Any, Generic, TypeVar

from drivers.clock import Activity, Clock, Event, GivenUp, SystemClock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from rig.threads import DeviceThread, error_of_driver, waited_for_processor_s

T = TypeVar("T")

STOPPING_S = 6.0
"""Deadline in s of a hold or stop when nothing should move. The drivers of offaxis give up after 5 s."""
CAMERA_MARGIN_S = 2.0
"""A camera's call may take this time in s longer than the protocol's `timeout_s`, for copying the image."""
PATIENCE_S = 30.0
"""Real time in s added to each deadline on a virtual rig. Its devices compute while simulated time stands
still. A device that computes, or that waits for a processor, gets this time again and again."""
_COMPUTING = 0.05
"""Part of a processor that a computing device gets even on a busy computer; one that waits uses less."""
LEAVING_S = 2.0
"""Real time in s for which the end of a run waits for calls that still run, such as a long exposure."""
_PATIENCES_MAX = 20
"""A device that has computed for this number of patiences hangs in a loop."""
_STARVED = 0.2
"""If a call waits for a processor for this part of its deadline, the computer is too busy."""
_TICK_S = 1e-9
"""A smaller difference between two times, in s, is a rounding error."""


@dataclass(frozen=True)
class Deadline:
    """The longest time of a call, and the advice for the user if the call takes longer.

    A machine continues to move during a call that hangs. So the deadline of the call and the following stop
    together take less than 1 s.
    """

    duration_s: float
    remedy: str = "check the device and its cable, and report the hanging call to the author of its driver"


NEVER = Deadline(math.inf)


class Call(Generic[T]):
    """One call of a driver, or of another function that may take long.

    `future` receives the result or the exception. If `cancelled` is True before the call begins, it is not
    made.
    """

    def __init__(
        self,
        device: str,
        action: str,
        function: Callable[[], T],
        deadline: Deadline,
        clock: Clock,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.device = device
        self.action = action
        self.deadline = deadline
        self.future: Future[T] = Future()
        self.cancelled = False
        self._function = function
        self._clock = clock
        self._due_s = clock.now_s() + deadline.duration_s
        self._patience_s = patience_s
        self._real_due_s = SystemClock().now_s() + deadline.duration_s + patience_s
        self._thread = 0
        self._before_s = self._begun_s = self._seen_s = 0.0
        self._begun_s = self._seen_s = self._effort_s()

    def run(self) -> None:
        """Call the function. This method runs on the device's thread."""
        if self.cancelled:
            return
        self._thread = get_native_id()
        self._before_s = waited_for_processor_s(self._thread)
        try:
            value = self._function()
        except GivenUp:
            raise
        except BaseException as error:
            self.future.set_exception(error_of_driver(self.device, self.action, error))
        else:
            self.future.set_result(value)

    @property
    def done(self) -> bool:
        """True if the call has ended."""
        return self.future.done()

    @property
    def left_s(self) -> float:
        """Time in s until the call's deadline, on the rig's clock."""
        return self._due_s - self._clock.now_s()

    @property
    def real_left_s(self) -> float:
        """Real time in s until the engine gives up the call, even if the rig's clock stands still."""
        if self._real_due_s <= SystemClock().now_s() and self._computes():
            self._real_due_s += self._patience_s
        return self._real_due_s - SystemClock().now_s()

    @property
    def is_over(self) -> bool:
        """True if the call has ended or exceeded its deadline, so that `Calls.finish` returns at once."""
        return self.done or self.left_s <= _TICK_S or self.real_left_s <= 0.0

    @property
    def waited_s(self) -> float:
        """Time in s for which the call was ready to go on and got no processor."""
        return waited_for_processor_s(self._thread) - self._before_s if self._thread else 0.0

    def _effort_s(self) -> float:
        return process_time() + self.waited_s

    def _computes(self) -> bool:
        """Return whether the program has computed since the last question, or wanted to."""
        before_s, self._seen_s = self._seen_s, self._effort_s()
        recent_s, whole_s = self._seen_s - before_s, self._seen_s - self._begun_s
        return recent_s >= _COMPUTING * self._patience_s and whole_s < _PATIENCES_MAX * self._patience_s


class Calls:
    """Runs calls on the threads of their devices, and waits for them on the engine's thread.

    If a call exceeds its deadline, its device counts as lost. From then on only `SafeState` calls this
    device.

    Parameters
    ----------
    clock : Clock
    check : callable
        Function that is called whenever the engine wakes from a wait that may be interrupted. The function
        raises an exception to end the run.
    lost : dict of str to str
        Receives for each lost device the name of the call that hangs.
    patience_s : float
        See `PATIENCE_S`.
    meanwhile : callable, optional
        Function that is called during each wait that is `watched`. An exception of this function or of
        `check` ends the wait at once.
    every_s : float
        The time in s between two calls of `meanwhile`.
    """

    def __init__(
        self,
        clock: Clock,
        check: Callable[[], None],
        lost: dict[str, str] | None = None,
        patience_s: float = PATIENCE_S,
        meanwhile: Callable[[], object] = lambda: None,
        every_s: float = math.inf,
    ) -> None:
        self.lost = {} if lost is None else lost
        self._meanwhile = meanwhile
        self._every_s = every_s
        self._patience_s = patience_s
        self._clock = clock
        self._check = check
        self._news = Event()
        self._workers: dict[str, _Worker] = {}

    def interrupt(self) -> None:
        """Wake the engine from a wait, so that it calls `check` at once. Any thread may call this method."""
        self._news.set()

    def idle(self, device: str) -> bool:
        """Return whether the device is free: none of its calls runs, waits or hangs."""
        worker = self._workers.get(device)
        return device not in self.lost and (worker is None or worker.idle)

    def begin(self, device: str, action: str, function: Callable[[], T], deadline: Deadline) -> Call[T]:
        """Begin a call on its device's thread. The calls of one device are made one after the other.

        Raise `LinkLost` if an earlier call of this device hangs.
        """
        if device in self.lost:
            raise LinkLost(
                device, action, "a device that answers", self.lost[device], "start the program again"
            )
        call = Call(device, action, function, deadline, self._clock, self._patience_s)
        if device not in self._workers:
            self._workers[device] = _Worker(device, self._news, self._clock)
            self._workers[device].start()
        self._workers[device].add(call)
        return call

    def do(self, device: str, action: str, function: Callable[[], T], deadline: Deadline) -> T:
        """Call a driver, wait for the end of the call, and return its result."""
        return self.finish(self.begin(device, action, function, deadline))

    def follow(self, future: "Future[T]", device: str, action: str, deadline: Deadline) -> Call[T]:
        """Return a `Call` that represents work which was begun elsewhere and takes no simulated time."""
        call: Call[T] = Call(device, action, future.result, deadline, self._clock)
        call.future = future
        activity = self._clock.activity(at_once=True)

        def ended(_: object) -> None:
            self._news.set()
            activity.end()

        future.add_done_callback(ended)
        return call

    def finish(self, call: Call[T], *, watched: bool = False) -> T:
        """Wait for the end of a call, and return its result.

        If the wait is not `watched`, nothing but the call's deadline ends it, so watch every long call. Raise
        `DeviceTimeout` if the call exceeds its deadline. The device of the call then counts as lost.
        """
        try:
            return self._wait_for(call, watched)
        finally:
            self._leave(call)

    def finish_unless(self, call: Call[Any], over: Callable[[], bool]) -> None:
        """Wait as `finish` with `watched`, but no longer than until `over` returns True.

        What makes `over` true must then call `interrupt`.
        """

        class Over(Exception):
            pass

        def meanwhile() -> None:
            if over():
                raise Over

        try:
            self._wait_for(call, watched=True, woken=meanwhile)
        except Over:
            pass
        finally:
            self._leave(call)

    def pause(self, duration_s: float) -> None:
        """Wait on the rig's clock. The wait ends early if the engine is interrupted."""
        end_s = self._clock.now_s() + duration_s
        while True:
            self._news.clear()
            self._check()
            left_s = end_s - self._clock.now_s()
            if left_s <= _TICK_S:
                return
            self._clock.wait(self._news, left_s)

    def close(self) -> None:
        """End the threads of all devices. A device whose call does not end in time counts as lost."""
        end_s = SystemClock().now_s() + LEAVING_S
        for device, worker in self._workers.items():
            worker.leave()
            if device in self.lost or worker.waits_for_a_person:
                continue
            worker.join(max(0.0, end_s - SystemClock().now_s()))
            if worker.is_alive():
                self.lost[device] = f"{worker.action}, which has not returned at the end of the run"

    def _leave(self, call: Call[Any]) -> None:
        call.cancelled = True
        if not call.done and call.device in self._workers:
            # The engine has given up the call, so simulated time may pass without it.
            self._workers[call.device].give_up()

    def _wait_for(self, call: Call[T], watched: bool, woken: Callable[[], None] = lambda: None) -> T:
        every_s = self._every_s if watched else math.inf
        next_s = self._clock.now_s() + every_s
        while True:
            # Clear the flag before checking the conditions, so that a change during the check sets the flag
            # again.
            self._news.clear()
            if watched:
                self._check()
            if call.done:
                return call.future.result()
            woken()
            if call.left_s <= _TICK_S or call.real_left_s <= 0.0:
                raise self._overdue(call)
            left_s = min(call.left_s, next_s - self._clock.now_s())
            self._clock.wait(self._news, left_s, call.real_left_s)
            if watched and not call.done and self._clock.now_s() >= next_s - _TICK_S:
                self._meanwhile()
                next_s = self._clock.now_s() + every_s

    def _overdue(self, call: Call[Any]) -> DeviceError:
        duration_s = call.deadline.duration_s
        self.lost[call.device] = f"{call.action}, which has not returned for {duration_s:g} s"
        if call.device in self._workers:
            self._workers[call.device].give_up()
        got, remedy = "none: the call hangs", call.deadline.remedy
        if call.waited_s >= _STARVED * duration_s:
            got = f"none: the computer let it wait {call.waited_s:.1f} s for a processor"
            remedy = "end other programs on this computer, or give it more processors"
        return DeviceTimeout(
            call.device, call.action, f"the end of the call within {duration_s:g} s", got, remedy
        )


@dataclass
class _Entry:
    """A call that runs or waits on the thread of its device. Only the first one has an activity."""

    call: Call[Any]
    activity: Activity | None = None
    given_up: bool = False


class _Worker(DeviceThread):
    """The thread that makes all calls of one device."""

    def __init__(self, device: str, news: Event, clock: Clock) -> None:
        super().__init__(f"calls of {device}")
        self.action = ""
        self.waits_for_a_person = False
        self._news, self._clock = news, clock
        self._waiting: queue.SimpleQueue[_Entry | None] = queue.SimpleQueue()
        self._entries: list[_Entry] = []
        self._lock = Lock()

    @property
    def idle(self) -> bool:
        """True if no call runs or waits on this thread."""
        return not self._entries

    def add(self, call: Call[Any]) -> None:
        entry = _Entry(call)
        with self._lock:
            self._entries.append(entry)
            self._announce_first()
        self._waiting.put(entry)

    def give_up(self) -> None:
        """Let simulated time pass without waiting for the calls on this thread."""
        with self._lock:
            entries = tuple(self._entries)
            for entry in entries:
                entry.given_up = True
        for entry in entries:
            if entry.activity is not None:
                entry.activity.end()

    def leave(self) -> None:
        self.give_up()
        self._waiting.put(None)

    def run(self) -> None:
        while (entry := self._waiting.get()) is not None:
            call, activity = entry.call, entry.activity
            assert activity is not None
            self.action, self.waits_for_a_person = call.action, call.deadline.duration_s == math.inf
            # Suppress `GivenUp`, which ends a call of a simulated device after the engine has given up the
            # call.
            with suppress(GivenUp), activity:
                try:
                    call.run()
                    self._news.set()
                finally:
                    self._end(entry)
            self.waits_for_a_person = False

    def _end(self, entry: _Entry) -> None:
        with self._lock:
            self._entries.remove(entry)
            self._announce_first()

    def _announce_first(self) -> None:
        """Announce the work of the first call.

        A call that waits for another one is announced only when that one ends. On a simulated clock its
        activity would otherwise get its turn, while its thread still sleeps in the other call for ever.
        """
        if self._entries and (first := self._entries[0]).activity is None:
            first.activity = self._clock.activity()
            if first.given_up:
                first.activity.end()
