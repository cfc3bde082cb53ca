"""Signals end a run safely instead of killing it."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rig.engine.engine import Engine
from rig.errors import Aborted

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
"""Signals that end or suspend a program; a suspended program would not watch the moving devices."""


@contextmanager
def aborting_on_signals(engine: Engine) -> Iterator[None]:
    """Turn `SIGNALS` into `Engine.abort`; Python allows this only in the main thread.

    A signal that is ignored, such as SIGHUP under ``nohup``, stays ignored.
    """
    interrupted = False

    def handle(number: int, _: FrameType | None) -> None:
        nonlocal interrupted
        name = signal.Signals(number).name
        engine.abort(name)
        if engine.waiting_for_operator and not interrupted:
            # Python resumes a read from the terminal after a signal; only an exception ends the read. Only
            # the first signal raises: a second exception would interrupt the safe state.
            interrupted = True
            raise Aborted("waiting for the operator", "an answer", name, "start the run again")

    previous = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        for number, handler in previous.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, handle)
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
