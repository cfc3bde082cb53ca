"""Ends a process with the one that started it, also if that one was killed."""

import os
import select
import signal
import threading

from drivers.clock import SystemClock

_LOOK_S = 0.2


def end_with(parent: int) -> None:
    """Let a thread, which costs nothing, kill this process and those it has started when `parent` ends.

    `parent` is the number of the process that started this one. This process leads a group of its own, or
    belongs to that of such a process.
    """
    threading.Thread(target=_wait_and_end, args=(parent,), name="end with the run", daemon=True).start()


def _wait_and_end(parent: int) -> None:
    try:
        descriptor = os.pidfd_open(parent)
    except (OSError, AttributeError):
        # The process has ended already, or the system cannot watch processes.
        descriptor = -1
    if descriptor >= 0:
        waiting = select.poll()
        waiting.register(descriptor, select.POLLIN)
        while os.getppid() == parent and not waiting.poll():
            pass
    clock = SystemClock()
    while os.getppid() == parent:
        clock.sleep(_LOOK_S)
    os.killpg(os.getpgrp(), signal.SIGKILL)
