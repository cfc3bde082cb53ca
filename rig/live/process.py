"""The process that measures live gauges: ``python -m rig.live.process``, started by `rig.live.beside`.

It does nothing else, so that neither the writing of files nor a plot can hold it up.
"""

import gc
import os
import select
import sys
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from rig.live.control import Control
from rig.live.field_link import FieldLink, FieldsFailed
from rig.live.fields import FieldTasks
from rig.live.frame_ring import FrameRing
from rig.live.given import FAILED, READING, READY, REFUSED, Given, Prepare
from rig.live.job import prepared
from rig.live.lifeline import end_with
from rig.live.measuring import Measuring, Shown, warm_up
from rig.live.pairing import Pairing, Together
from rig.live.pipes import Inbox, Outbox

if TYPE_CHECKING:
    from dic.live import LiveSetups

_NICENESS = -10
_SESSION_NICENESS = 19
_ALIVE_S = 0.1
_WAIT_S = 3600.0
_FIELDS_S = 120.0
_CHUNK = 1 << 16


def main() -> None:
    """Measure the frames of one run until the run ends."""
    end_with(int(sys.argv[1]))
    inbox, outbox = Inbox(0), Outbox(os.dup(1))
    # A library that prints must not write between the messages.
    os.dup2(2, 1)
    messages = _two(inbox)
    given: Given = messages[0]
    rings = {name: FrameRing(shape, descriptor) for name, (shape, descriptor) in given.rings.items()}
    try:
        setups = prepared(given.job, messages[1].grids, messages[1].references)
        rings = {name: rings[name] for name in setups.cameras}
        warm_up(setups)
        link = FieldLink(setups, rings)
        if not link.wait(_FIELDS_S):
            raise FieldsFailed(f"the process that solves whole fields was not ready within {_FIELDS_S:g} s")
    except Exception as error:
        outbox.send((REFUSED, error if isinstance(error, DeviceError) else _words(error)), _WAIT_S)
        os._exit(0)
    loop = Loop(given, setups, rings, link, outbox)
    # What is there now stays. So the collections of the garbage that frames leave are short.
    gc.collect()
    gc.freeze()
    _go_first()
    outbox.send((READY, None), _WAIT_S)
    try:
        while not inbox.is_closed:
            loop.once(inbox)
    except Exception as error:
        outbox.send((FAILED, _words(error)), _WAIT_S)
    os._exit(0)


class Loop:
    """Measures frames as they come, gives fields to the other process, and tells the values.

    Parameters
    ----------
    given : Given
    setups : LiveSetups
    rings : dict of str to FrameRing
    link : FieldLink
    outbox : Outbox
    """

    def __init__(
        self,
        given: Given,
        setups: "LiveSetups",
        rings: dict[str, FrameRing],
        link: FieldLink,
        outbox: Outbox,
    ) -> None:
        self._clock = SystemClock()
        self._rings, self._link, self._outbox = rings, link, outbox
        self._measuring = Measuring(setups, given.job.table.camera)
        self._tasks = FieldTasks(setups, given.job.table.field_every_s)
        self._control, self._wake = Control(given.control), given.wake
        os.set_blocking(given.wake, False)
        self._pairing = Pairing(rings, self._clock.now_s())
        self._seen = {name: ring.newest for name, ring in rings.items()}
        self._measured = dict(self._seen)
        self._left_out = 0
        self._poll = select.poll()
        self._watched = -1

    def once(self, inbox: Inbox) -> None:
        """Wait for a frame, an answer or a message, for a short time at most, and do what is to be done."""
        self._wait(inbox)
        now_s = self._control.alive_s = self._clock.now_s()
        for name, ring in self._rings.items():
            for arrival in ring.arrivals(self._seen[name]):
                self._pairing.arrived(name, arrival, now_s)
                self._seen[name] = arrival.number
        together = self._pairing.next(now_s)
        if together is not None:
            self._measure(together)
        else:
            self._locate()
        for answer in self._link.take():
            answer.give_to(self._measuring)
        self._outbox.flush()
        inbox.take()

    def _wait(self, inbox: Inbox) -> None:
        if self._watched != self._link.descriptor:
            self._poll = select.poll()
            for descriptor in (inbox.descriptor, self._wake, self._link.descriptor):
                self._poll.register(descriptor, select.POLLIN)
            self._watched = self._link.descriptor
        waits_s = min(_ALIVE_S, self._pairing.waits_s(self._clock.now_s()))
        self._poll.poll(1000.0 * waits_s)
        with suppress(BlockingIOError):
            os.read(self._wake, _CHUNK)

    def _locate(self) -> None:
        """Find the points in frames that wait for those of another camera."""
        for name, arrival in self._pairing.newest_waiting.items():
            with self._rings[name].held(arrival.number) as image:
                if image is not None:
                    self._measuring.locate(name, Shown(arrival, image))

    def _measure(self, together: Together) -> None:
        numbers = {name: arrival.number for name, arrival in together.frames.items()}
        frames: dict[str, Shown] = {}
        with ExitStack() as held:
            for name, arrival in together.frames.items():
                image = held.enter_context(self._rings[name].held(arrival.number))
                if image is None:
                    # Newer frames have replaced it, and are measured instead.
                    return
                frames[name] = Shown(arrival, image)
            reading = self._measuring.measure(frames, together.missing)
        self._outbox.put((READING, replace(reading, known_s=self._clock.now_s())))
        self._left_out += sum(number - self._measured[name] - 1 for name, number in numbers.items())
        self._measured |= numbers
        self._control.left_out = self._left_out
        if self._link.is_free:
            task = self._tasks.next(numbers, reading.time_s, self._measuring, self._clock.now_s())
            if task is not None:
                self._link.ask(task)


def _two(inbox: Inbox) -> list[Any]:
    """Wait for the two first messages; end if the run ends before."""
    found: list[Any] = []
    while len(found) < 2:
        found += inbox.wait(_WAIT_S)
        if inbox.is_closed:
            os._exit(0)
    assert isinstance(found[1], Prepare)
    return found


def _go_first() -> None:
    """Give this process a higher priority if the system permits it, but not the processes that it starts."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
    with suppress(OSError, AttributeError):
        least = os.sched_param(os.sched_get_priority_min(os.SCHED_RR))
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, least)
        # Linux shares the processors between sessions first. That of this process, which needs no share any
        # more, has only the solver of fields beside it, and would otherwise get as much as the run.
        Path("/proc/self/autogroup").write_text(str(_SESSION_NICENESS))


def _words(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, (DeviceError, FieldsFailed)) else f"{type(error).__name__}: {text}"


if __name__ == "__main__":
    main()
