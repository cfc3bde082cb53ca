"""Let signals end a run safely. Without this module, a signal would kill or suspend the program."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Protocol

from rig.threads import must_end

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
"""Signals that end or suspend a program. A suspended program would not watch its moving devices."""


class Abortable(Protocol):
    """Interface of an object that a signal can end: an `Engine` or a motion by hand."""

    def abort(self, reason: str) -> None:
        """Command hold and stop, and request the end of the run or motion without waiting."""


@contextmanager
def aborting_on_signals(engine: Abortable) -> Iterator[None]:
    """Within the `with` block, make each of the `SIGNALS` abort the run or the motion by hand.

    Python permits this only in the main thread. A separate thread receives the signals and calls
    `engine.abort`. So the abort comes at once, even if the main thread hangs in a call or holds a lock. A
    signal that was ignored before, for example SIGHUP under ``nohup``, stays ignored.
    """
    arriving, departing = os.pipe()
    os.set_blocking(departing, False)

    def abort_on_arrival() -> None:
        while numbers := os.read(arriving, 64):
            for number in numbers:
                # Ignore other signals that arrive here, for example SIGWINCH of a terminal whose size
                # changes.
                if number in handled:
                    must_end()
                    engine.abort(signal.Signals(number).name)

    previous = {number: signal.getsignal(number) for number in SIGNALS}
    handled = {number for number, handler in previous.items() if handler is not signal.SIG_IGN}
    watching = threading.Thread(target=abort_on_arrival, name="signals", daemon=True)
    watching.start()
    previous_descriptor = signal.set_wakeup_fd(departing, warn_on_full_buffer=False)
    try:
        for number in handled:
            signal.signal(number, _note)
        yield
    finally:
        for number in handled:
            signal.signal(number, previous[number])
        signal.set_wakeup_fd(previous_descriptor)
        os.close(departing)
        watching.join()
        os.close(arriving)


def _note(_: int, __: FrameType | None) -> None:
    """Do nothing, because Python has already written the signal's number to the descriptor."""
