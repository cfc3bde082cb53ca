"""Base class of GenICam cameras: a silent camera is opened again on a thread of its own."""

import contextlib
import threading
from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, Protocol, TypeVar

from drivers.cameras.filming import FilmingCamera, FilmingSession
from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost

T = TypeVar("T")
GIVING_UP_S = 20.0
"""Longest time, in seconds, that `close` waits for a connection to end.

Aravis needs up to 13 s to close the connection to a camera that is disconnected.
"""


class GenicamSession(FilmingSession, Protocol):
    """A `FilmingSession` of a GenICam camera, which may have an output line."""

    def pulse(self) -> None:
        """Begin a pulse on the output line. Raise `DeviceError` if it may not have been given.

        Another thread may take frames meanwhile. After `close`, raise `LinkLost`.
        """


S = TypeVar("S", bound=GenicamSession)


class GenicamCamera(FilmingCamera[S]):
    """A `FilmingCamera` whose library needs seconds to close or to open a camera that is silent.

    If `grab` waits for three frame times without a frame, the camera counts as lost. The driver then closes
    the connection, and the next call opens and configures the camera again. A separate thread closes and
    opens the camera, so that calls keep their deadlines.
    """

    silent_is_lost = True

    def __init__(self, name: str, clock: Clock) -> None:
        super().__init__(name, clock)
        self._aside: Future[S | None] | None = None

    def pulse(self) -> None:
        """Begin a pulse on the output line that the rig file names, also during a stream or `grab`.

        So the camera is a `TriggerOutput`. The pulse ends by itself after `pulse_ms`. Raise `DeviceFault` if
        the program drives no line of this camera, or if the pulse before has not ended or did not end in
        time. Raise another `DeviceError` if the pulse may not have been given.
        """
        session = self._session
        if session is None:
            raise LinkLost(
                self._name, "pulse", "an opened camera", "a closed or lost one", "open the camera again"
            )
        session.pulse()

    def close(self) -> None:
        """Release the camera. A repeated call has no effect.

        If the camera does not answer, the method waits for a limited time only.
        """
        super().close()
        with self._lock:
            last, self._aside = self._aside, None
        if last is not None and not is_done(last, GIVING_UP_S):
            return
        if last is not None:
            with contextlib.suppress(DeviceError):  # a camera that could not be reopened needs no closing
                if (session := last.result()) is not None:
                    session.close()
        self._let_go()

    def _let_go(self) -> None:
        """Release what the library keeps for the camera, after its connection has ended."""

    @abstractmethod
    def _open(self) -> S:
        """Open the camera. Raise `LinkLost` if it is not there, or if another camera is in its place."""

    def _open_again(self, step: str, deadline_s: float) -> S:
        session: S | None = None
        while session is None:
            if self._aside is None:
                self._aside = aside(f"open {self._name}", self._open)
            if not is_done(self._aside, deadline_s - self._clock.now_s()):
                raise DeviceTimeout(
                    self._name,
                    step,
                    "a camera that can be opened again in time",
                    "a connection that is still being given up or made",
                    "check cable, power and the firewall, or allow more time",
                )
            done, self._aside = self._aside, None
            session = done.result()
        return session

    def _give_up(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            self._aside = aside(f"close {self._name}", session.close)


def aside(name: str, act: Callable[[], T]) -> "Future[T]":
    """Call a function on a separate thread, and return its future result."""
    done: Future[T] = Future()

    def run() -> None:
        try:
            done.set_result(act())
        except Exception as error:  # `result` raises the exception again
            done.set_exception(error)

    threading.Thread(target=run, name=name, daemon=True).start()
    return done


def is_done(future: "Future[Any]", timeout_s: float) -> bool:
    """Wait until a future has its result, at most `timeout_s` seconds. Return whether it has."""
    return bool(wait([future], max(0.0, timeout_s)).done)
