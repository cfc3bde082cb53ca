"""The link of the live measurement to the process that solves whole fields, which may fail and come again."""

import os
import pickle
from collections.abc import Mapping
from typing import TYPE_CHECKING

from drivers.clock import SystemClock
from rig.live.fields import LATE, READY, FieldAnswer, FieldsGiven, FieldTask
from rig.live.frame_ring import FrameRing
from rig.live.memory import SharedMemory
from rig.live.pipes import Inbox, Outbox
from rig.live.starting import Started

if TYPE_CHECKING:
    from dic.live import LiveSetups

_MODULE = "rig.live.field_process"
_STARTS_MAX = 4
_SEND_S = 5.0
_HANG_S = 60.0
"""A field takes a good part of a second, on a busy computer some seconds."""


class FieldsFailed(Exception):
    """The process that solves fields has ended too often. The message says how."""


class FieldLink:
    """Gives tasks to a process of its own, and takes the answers, without waiting.

    Parameters
    ----------
    setups : LiveSetups
    rings : mapping of str to FrameRing
        By the names of the cameras.
    """

    def __init__(self, setups: "LiveSetups", rings: Mapping[str, FrameRing]) -> None:
        content = pickle.dumps(setups, protocol=5)
        self._memory = SharedMemory(len(content))
        self._memory.buffer[: len(content)] = content
        frames = {name: (ring.frames, ring.memory.descriptor) for name, ring in rings.items()}
        self._given = FieldsGiven(self._memory.descriptor, len(content), frames)
        self._clock = SystemClock()
        self._starts = 0
        self._asked_s: float | None = None
        self._start()

    @property
    def is_free(self) -> bool:
        """True if the process waits for a task."""
        return self._asked_s is None

    @property
    def descriptor(self) -> int:
        """The descriptor that can be read when an answer has come, or the process has ended."""
        return self._inbox.descriptor

    def ask(self, task: FieldTask) -> None:
        """Give a task to a free process."""
        self._asked_s = self._clock.now_s()
        try:
            self._outbox.put(task)
        except OSError:
            # Its end is noticed by `take`.
            return

    def take(self) -> list[FieldAnswer]:
        """Return the answers that have come. Start the process anew if it has ended or hangs.

        Raise `FieldsFailed` after several ends.
        """
        found: list[FieldAnswer] = []
        for message in self._inbox.take():
            self._asked_s = None
            if message != READY and message.problem != LATE:
                found.append(message)
        hangs = self._asked_s is not None and self._clock.now_s() - self._asked_s > _HANG_S
        if hangs or self._inbox.is_closed:
            self._again(hangs=hangs)
        return found

    def wait(self, within_s: float) -> bool:
        """Wait until the process is free; return False if that takes too long."""
        end_s = self._clock.now_s() + within_s
        while not self.is_free:
            if (left_s := end_s - self._clock.now_s()) <= 0.0:
                return False
            self._inbox.wait_readable(left_s)
            self.take()
        return True

    def _start(self) -> None:
        """Start a process, which is free as soon as it says so."""
        self._starts += 1
        descriptors = [self._given.setups, *(descriptor for _, descriptor in self._given.rings.values())]
        self._started = Started(_MODULE, descriptors, new_group=False)
        self._inbox, self._outbox = Inbox(os.dup(self._started.back)), Outbox(self._started.to)
        self._asked_s = self._clock.now_s()
        self._outbox.send(self._given, _SEND_S)

    def _again(self, *, hangs: bool) -> None:
        process = self._started.process
        process.kill()
        process.wait()
        ending = f"did not answer for {_HANG_S:g} s" if hangs else self._started.ending
        os.close(self._inbox.descriptor)
        self._started.close()
        if self._starts >= _STARTS_MAX:
            raise FieldsFailed(f"the process that solves whole fields {ending}, at {self._starts} starts")
        self._start()
