"""The time that one call of a driver may take. All requests of the call together keep the rig's deadline."""

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TypeVar, cast

from drivers.clock import Clock, SystemClock
from drivers.errors import DeviceTimeout

MARGIN_S = 0.08
"""Time, in seconds, before the rig's deadline at which a driver reports a missing answer itself."""
MARGIN_SHARE = 0.2
"""Largest margin, as a share of the deadline."""
OPENING_S = 4.0
"""Time, in seconds, for all requests that open a device. A long reply timeout of the device extends it."""
OPENING_ANSWERS = 4
"""Opening may take the time of this number of reply timeouts, if that time is longer than `OPENING_S`."""


class CallTime:
    """The end of the present call, in seconds of real time. Each thread has a call of its own.

    A call may need several requests. If one answer is late, the call still waits for it as long as the
    deadline allows. If no answer comes, the driver reports this before the rig gives up the call as hanging.

    `timeout_s` is the rig's deadline of one call, which is infinite outside a rig. `clock` is the clock for
    the deadlines. The default is the system's clock. `patience_s` is the additional time for each call, and
    for each answer during opening: `OpenContext.patience_s`.
    """

    def __init__(
        self, timeout_s: float = math.inf, clock: Clock | None = None, patience_s: float = 0.0
    ) -> None:
        margin_s = 0.0 if timeout_s == math.inf else min(MARGIN_S, MARGIN_SHARE * timeout_s)
        self._usable_s = timeout_s - margin_s + patience_s
        self._patience_s = patience_s
        self._clock = clock or SystemClock()
        self._of_thread = threading.local()

    @contextmanager
    def call(self, within_s: float = math.inf) -> Iterator[None]:
        """Begin a call on this thread. A call within another call ends at the end of the outer call.

        `within_s` is the time, in seconds, that the caller gives this call, if that is less than the deadline
        of every call.
        """
        if self._end_s < math.inf:
            yield
            return
        usable_s = min(self._usable_s, within_s + self._patience_s)
        self._of_thread.end_s = self._clock.now_s() + usable_s
        try:
            yield
        finally:
            self._of_thread.end_s = math.inf

    @contextmanager
    def opening(self, reply_timeout_s: float) -> Iterator[None]:
        """Limit the time for opening a device, which takes more requests than one call.

        A missing answer is reported after the reply timeout. This limit detects a device whose answers all
        come late: each request succeeds, but the device cannot be used. Raise `DeviceTimeout` if an answer is
        missing when the time is over.
        """
        limit_s = max(OPENING_S, OPENING_ANSWERS * reply_timeout_s) + self._patience_s
        self._of_thread.end_s, self._of_thread.opening = self._clock.now_s() + limit_s, True
        try:
            yield
        except DeviceTimeout as error:
            if self.left_s > 0:
                raise
            raise DeviceTimeout(
                error.device,
                "open",
                f"all answers within {limit_s:g} s",
                f"late answers, and at last {error.got} ({error.step})",
                f"check the line; for a slow device raise reply_timeout_s above {reply_timeout_s:g}",
            ) from error
        finally:
            self._of_thread.end_s, self._of_thread.opening = math.inf, False

    def first_wait_s(self, wait_s: float) -> float:
        """Return how long to wait before a request is repeated: `wait_s`, or less if the call ends before."""
        if self._opening:
            wait_s += self._patience_s
        return min(wait_s, self.left_s)

    def last_wait_s(self, wait_s: float) -> float:
        """Return how long to wait for the answer to the last attempt: until the end of the call.

        Outside a call this is `wait_s`. During opening it is the same as `first_wait_s`.
        """
        return self.left_s if self.patient else self.first_wait_s(wait_s)

    @property
    def patient(self) -> bool:
        """True if a late answer may still be used: within a call, but not while the device is opened."""
        return self._end_s < math.inf and not self._opening

    @property
    def _opening(self) -> bool:
        return getattr(self._of_thread, "opening", False)

    @property
    def left_s(self) -> float:
        """Time until the end of the call, which is infinite outside a call and never negative."""
        return max(0.0, self._end_s - self._clock.now_s())

    @property
    def _end_s(self) -> float:
        return getattr(self._of_thread, "end_s", math.inf)


M = TypeVar("M", bound=Callable[..., Any])


def one_call(method: M) -> M:
    """Make all requests of a driver's method keep one deadline, given by the attribute ``_call_time``."""

    @wraps(method)
    def timed(self: Any, *arguments: Any, **named: Any) -> Any:
        with self._call_time.call():
            return method(self, *arguments, **named)

    return cast(M, timed)
