"""The process that solves whole fields: ``python -m rig.live.field_process``, at a low priority.

The process of the live gauges starts it, and gives it tasks one by one. Frames are copied from shared memory.
"""

import gc
import os
import pickle
import sys
from contextlib import suppress
from typing import Any

import numpy as np

from drivers.clock import SystemClock
from rig.live.fields import LATE, READY, FieldAnswer, FieldsGiven, FieldTask, FieldWork
from rig.live.frame_ring import FrameRing
from rig.live.lifeline import end_with
from rig.live.memory import SharedMemory
from rig.live.pipes import Inbox, Outbox

_NICENESS = 10
_WAIT_S = 3600.0


def main() -> None:
    """Do tasks until the process of the live gauges ends."""
    end_with(int(sys.argv[1]))
    with suppress(OSError):
        os.nice(_NICENESS)
    inbox, outbox = Inbox(0), Outbox(os.dup(1))
    # A library that prints must not write between the messages.
    os.dup2(2, 1)
    given: FieldsGiven = _received(inbox)[0]
    rings = {name: FrameRing(shape, descriptor) for name, (shape, descriptor) in given.rings.items()}
    with SharedMemory(given.size, given.setups) as memory:
        work = FieldWork(pickle.loads(memory.buffer[: given.size]))
    work.warm_up()
    gc.collect()
    gc.freeze()
    outbox.send(READY, _WAIT_S)
    while tasks := _received(inbox):
        for task in tasks:
            outbox.send(_answer(work, task, rings), _WAIT_S)


def _received(inbox: Inbox) -> list[Any]:
    """Wait for messages; none come after the other process has closed the pipe."""
    clock = SystemClock()
    while not (found := inbox.wait(_WAIT_S)) and not inbox.is_closed:
        clock.sleep(0.0)
    return found


def _answer(work: FieldWork, task: FieldTask, rings: dict[str, FrameRing]) -> FieldAnswer:
    images = {}
    for name, number in task.frames.items():
        with rings[name].held(number) as image:
            if image is None:
                return FieldAnswer(task, problem=LATE)
            images[name] = np.array(image)
    return work.done(task, images)


if __name__ == "__main__":
    main()
