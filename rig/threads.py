"""Threads for driver calls, which may hang. The program can end although such a thread hangs."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Generic, TypeVar

from drivers.clock import Event, SystemClock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout

_LAST_S = 0.5
"""Real time in s that the end of the program waits for threads that are just ending."""
LAST_RESORT_S = 180.0
"""Real time in s from the first signal, or from the last sign of progress, to the end of the program.
Stopping the machines and closing run file and devices have shorter deadlines together."""
OUTPUT_S = 5.0
"""Real time in s that a program that was told to end waits for its terminal or pipe."""
_WORDS_MAX = 200
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

T = TypeVar("T")


def waited_for_processor_s(thread: int) -> float:
    """Return for how long a thread of this process was ready to run and got no processor, in s.

    The result is 0 if the system does not tell. Source: proc(5), ``/proc/PID/task/TID/schedstat``, whose
    second number is this time in ns.
    """
    try:
        return int(Path(f"/proc/self/task/{thread}/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError, ValueError):
        return 0.0


class DeviceThread(threading.Thread):
    """A daemon thread for driver calls. The program can end although such a call hangs."""

    def __init__(self, name: str) -> None:
        super().__init__(name=name, daemon=True)


def error_of_driver(device: str, action: str, error: BaseException) -> BaseException:
    """Return the exception of a driver's call; a `DeviceFault` for one that no driver may raise.

    On the thread that waits for the call, a `SystemExit` would end the program, perhaps with the status of
    success, and an unknown exception would be a traceback. The exceptions of this program are returned as
    they are.
    """
    own = isinstance(error, DeviceError) or type(error).__module__.partition(".")[0] in _OWN
    if isinstance(error, Exception) and own:
        return error
    if isinstance(error, SystemExit | KeyboardInterrupt):
        got = f"a driver that ends the program ({type(error).__name__})"
    else:
        got = f"a driver that raises {type(error).__name__}{_words_of(error)}"
    fault = DeviceFault(device, action, "a call that returns or raises a DeviceError", got, "mend the driver")
    fault.__cause__ = error
    return fault


_OWN = ("dic", "drivers", "rig", "simulators")


def _words_of(error: BaseException) -> str:
    """Return the message of an exception as one line of printable characters."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        return ""
    shown = "".join(each for each in text if each.isprintable())[:_WORDS_MAX]
    return f" ({shown})" if shown else ""


class Bounded(DeviceThread, Generic[T]):
    """One call on a separate thread, such as opening a device, with a deadline in real time.

    `device` and `action` are names for error messages. `undo` is called with the result if `function` returns
    after its deadline, for example to close a device. `hangs` is True if `function` did not return before the
    deadline.
    """

    def __init__(
        self, device: str, action: str, function: Callable[[], T], undo: Callable[[T], None] = lambda _: None
    ) -> None:
        super().__init__(f"{device}: {action}")
        self._device, self._action = device, action
        self._function = function
        self._undo = undo
        self._done = Event()
        self._turn = threading.Lock()
        self.hangs = False
        self._error: BaseException | None = None
        self._values: list[T] = []

    def run(self) -> None:
        """Call `function`. This method runs on the thread."""
        try:
            value = self._function()
        except BaseException as error:
            self._error = error_of_driver(self._device, self._action, error)
        else:
            with self._turn:
                self._values.append(value)
                late = self.hangs
            if late:
                self._undo(value)
        self._done.set()

    def result(self, deadline_s: float, remedy: str) -> T:
        """Call `function` on the thread, wait, and return its result or raise its exception.

        Raise `DeviceTimeout` if the function does not return within `deadline_s`.
        """
        self.start()
        try:
            self._done.wait_really(deadline_s)
        finally:
            with self._turn:
                self.hangs = not self._values and self._error is None
        if self._error is not None:
            raise self._error
        if self.hangs:
            raise DeviceTimeout(
                self._device, self._action, f"an end within {deadline_s:g} s", "none: the call hangs", remedy
            )
        return self._values[0]


@contextmanager
def dying_of_signals() -> Iterator[None]:
    """Let SIGINT, SIGTERM and SIGHUP end the program at once.

    Use this function only at the end of a program, when no device is open any more. While a program waits for
    a terminal to accept output, Python runs no signal handlers. Only the system's default action of these
    signals can then end the program. If a signal has come already, the output must be accepted soon.
    """
    _last_resort.hurry(OUTPUT_S)
    previous = {number: signal.getsignal(number) for number in _ENDING}
    changed = [number for number, handler in previous.items() if handler is not signal.SIG_IGN]
    try:
        for number in changed:
            signal.signal(number, signal.SIG_DFL)
        yield
    finally:
        for number in changed:
            signal.signal(number, previous[number])


class _LastResort:
    """The system's timer that ends this process, if it is a program and not one that uses the package."""

    def __init__(self) -> None:
        self.armed = self.ending = False

    def begin(self, after_s: float) -> None:
        if self.armed and not self.ending:
            signal.setitimer(signal.ITIMER_REAL, after_s)

    def hurry(self, after_s: float) -> None:
        if self.armed and self.ending:
            signal.setitimer(signal.ITIMER_REAL, after_s)


_last_resort = _LastResort()


@contextmanager
def drivers_exit_by_exception() -> Iterator[None]:
    """Within a `with` block, let `os._exit` and `os.abort` of a driver raise `SystemExit` instead.

    They would end the program at once: with a status that may be that of success, without a word, and without
    a stop of the machines. A process that a driver has forked may still end itself.
    """
    before = {name: getattr(os, name) for name in ("_exit", "abort")}
    own = os.getpid()

    def of_drivers(name: str) -> Callable[..., object]:
        def end(*status: int) -> object:
            if isinstance(threading.current_thread(), DeviceThread) and os.getpid() == own:
                raise SystemExit(*status)
            return before[name](*status)

        return end

    for name in before:
        setattr(os, name, of_drivers(name))
    try:
        yield
    finally:
        for name, function in before.items():
            setattr(os, name, function)


@contextmanager
def last_resort() -> Iterator[None]:
    """Within a `with` block, let the system end the program if it neither makes progress nor ends.

    The system sends SIGALRM, which Python does not handle. So the program ends also if it is short of memory,
    or if a driver never lets Python run. Its guardian then stops the machines, unless it has done so already.
    """
    _last_resort.armed, _last_resort.ending = True, False
    try:
        yield
    finally:
        _last_resort.armed = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def still_running() -> None:
    """Begin the time to the last resort again, unless the program is to end."""
    _last_resort.begin(LAST_RESORT_S)


def must_end() -> None:
    """Begin the time to the last resort for the last time."""
    _last_resort.begin(LAST_RESORT_S)
    _last_resort.ending = True


def device_threads() -> set[threading.Thread]:
    """Return the threads that are executing code of a driver at this moment."""
    return {thread for thread in threading.enumerate() if isinstance(thread, DeviceThread)}


def never_release(value: object) -> None:
    """Keep an object until the program ends, because its library could crash or hang when it releases it."""
    _never_released.append(value)
    # Python releases what lists hold when it ends. This reference is never given back.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(value))


_never_released: list[object] = []


def never_released() -> int:
    """Return the number of objects that are kept until the program ends."""
    return len(_never_released)


def leave(status: int, besides: Iterable[threading.Thread] = (), kept: int = 0) -> None:
    """End the program at once if a normal exit of Python could wait or crash.

    This is so if a driver's call hangs, or if an object must never be released. Otherwise this function does
    nothing.

    `status` is the exit status. The threads `besides` are ignored, because they existed before the command
    began. `kept` is the number of objects that were never to be released before the command began.
    """
    end_s = SystemClock().now_s() + _LAST_S
    hanging = device_threads().difference(besides)
    for thread in hanging:
        thread.join(max(0.0, end_s - SystemClock().now_s()))
    if not any(thread.is_alive() for thread in hanging) and never_released() == kept:
        return
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)
