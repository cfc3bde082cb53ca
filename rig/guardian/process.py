"""The process of the guardian: ``python -m rig.guardian.process``, started by `rig.guardian.guardian`.

The guardian first connects to each machine over a line of its own. Only then does the run continue. The
guardian stops every machine at once if the process of the run has ended, or if no sign of progress comes for
`patience_s`.
"""

import contextlib
import json
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.registry import Guard, find_driver
from rig.guardian import messages
from rig.guardian.lock import note_holder
from rig.guardian.stop import Stop

STDIN, STDOUT, STDERR = 0, 1, 2
IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGPIPE)
CHECK_PERIOD_S = 10.0
PERIOD_S = 0.02
SAY_S = 1.0
NICENESS = -10


@dataclass(frozen=True)
class GuardedRun:
    """The data that the guardian gets from the run at its start."""

    machines: list[dict[str, Any]]  # ``name``, ``driver`` and ``settings`` of each machine
    patience_s: float
    standing_patience_s: float
    log: str  # file to which the guardian writes what it has done
    locks: list[int]  # inherited descriptors of the machines' locks


def main() -> None:
    """Watch one run, and end with it."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    _go_first()
    os.set_blocking(STDOUT, False)
    job = GuardedRun(**json.loads(_first_line()))
    guards = _reach(job)
    if guards is not None:
        _tell(messages.READY, {name: guard.relay for name, guard in guards.items()})
        _check_regularly(guards)
        if reason := watch(STDIN, job, lambda: _tell(messages.ALIVE), _parent()):
            stop_and_say(guards, reason, job, STDIN)
        for guard in guards.values():
            guard.close()
    # end at once: a terminal that accepts no text must not keep a process alive that owns lines to machines
    os._exit(0)


def watch(run: int, job: GuardedRun, answer: Callable[[], None], parent: int | None = None) -> str:
    """Wait for the end of the run. Return why the machines must be stopped, or an empty text after a safe
    end.

    `run` is the descriptor of the pipe from the run. `answer` answers the run's question whether the guardian
    is alive. `parent` is a descriptor that becomes readable when the process of the run ends. The pipe also
    shows the end of the process, but not if a third process has inherited the run's side of the pipe.
    """
    clock = SystemClock()
    waiting = select.poll()
    waiting.register(run, select.POLLIN)
    if parent is not None:
        waiting.register(parent, select.POLLIN)
    patience = {messages.MOVING[0]: job.patience_s, messages.STANDING[0]: job.standing_patience_s}
    allowed_s, since_s = float("inf"), clock.now_s()
    while True:
        left_s = max(0.0, since_s + allowed_s - clock.now_s())
        ready = [
            descriptor for descriptor, _ in waiting.poll(None if left_s == float("inf") else left_s * 1000)
        ]
        if not ready:
            if clock.now_s() - since_s >= allowed_s:
                return f"the run made no progress for {allowed_s:g} s"
            continue
        received = os.read(run, messages.CHUNK) if run in ready else b""
        if messages.DONE in received:
            return ""
        if not received:
            return "the process of the run is gone"
        if messages.PING in received:
            answer()
        for sign in received:
            if sign in (*patience, messages.WAITING[0]):
                allowed_s, since_s = patience.get(sign, float("inf")), clock.now_s()


def _go_first() -> None:
    """Give this process a higher priority if the system permits it, so that a busy computer delays no stop.

    The guardian needs hardly any processor time, so it does not slow down other programs.
    """
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(os.sched_get_priority_min(os.SCHED_RR)))


def _first_line() -> bytes:
    received = b""
    while not received.endswith(b"\n"):
        if not (byte := os.read(STDIN, 1)):
            os._exit(0)
        received += byte
    return received


def _reach(job: GuardedRun) -> dict[str, Guard] | None:
    """Connect to each machine. If this fails, tell the run which machine cannot be reached, and return
    None."""
    guards: dict[str, Guard] = {}
    for machine in job.machines:
        try:
            spec = find_driver(machine["driver"])
            assert spec.guard is not None
            settings = spec.settings.model_validate_json(json.dumps(machine["settings"]))
            context = OpenContext(machine["name"], SystemClock())
            guards[machine["name"]] = spec.guard.open(settings, context)
        except DeviceError as error:
            _tell(messages.REFUSED, [type(error).__name__, *error.args])
            return None
        except Exception as error:
            # catch every exception, because a third party's guard may raise any type
            _tell(messages.REFUSED, ["", f"{machine['name']}: {type(error).__name__}: {error}"])
            return None
    return guards


def _check_regularly(guards: Mapping[str, Guard]) -> None:
    clock = SystemClock()

    def check(name: str, guard: Guard) -> None:
        while True:
            clock.sleep(CHECK_PERIOD_S)
            try:
                guard.check()
            except Exception as error:
                _tell(messages.LOST, f"{name}: {error}")

    for each in guards.items():
        threading.Thread(target=check, args=each, daemon=True).start()


def stop_and_say(guards: Mapping[str, Guard], reason: str, job: GuardedRun, run: int) -> None:
    """Stop all machines, report the result, repeat each stop that was not confirmed, and report again.

    Meanwhile answer the run's questions with the ages of the present attempts, so that the run can tell a
    guardian that goes on trying from one that hangs.
    """
    stop = Stop(guards)
    while not stop.tried:
        _answer_for(run, PERIOD_S, stop)
    for descriptor in job.locks:
        note_holder(descriptor, "the guardian of a run that has ended")
    _report(stop, reason, job)
    if stop.confirmed:
        return
    while not stop.ended:
        _answer_for(run, PERIOD_S, stop)
    _report(stop, reason, job)


def _answer_for(run: int, duration_s: float, stop: Stop) -> None:
    """Answer the run's questions for `duration_s`. A run that has ended asks none."""
    clock = SystemClock()
    end_s = clock.now_s() + duration_s
    waiting = select.poll()
    waiting.register(run, select.POLLIN)
    while (left_s := end_s - clock.now_s()) > 0.0:
        if not waiting.poll(left_s * 1000):
            return
        if not (received := os.read(run, messages.CHUNK)):
            clock.sleep(left_s)
            return
        if messages.PING in received:
            _tell(messages.ALIVE, stop.ages_s())


def _report(stop: Stop, reason: str, job: GuardedRun) -> None:
    sentence = f"{reason}: {stop.describe()}"
    _tell(messages.STOPPED, sentence)
    utc = SystemClock().utc().isoformat(timespec="milliseconds")
    _say(f"rig guardian: {sentence}", Path(job.log), utc)


def _say(sentence: str, log: Path, utc: str) -> None:
    def write() -> None:
        try:
            with log.open("a", encoding="utf-8") as file:
                file.write(f"{utc} {sentence}\n")
        except OSError as error:
            print(f"rig guardian: {log}: {error.strerror}", file=sys.stderr)
        os.write(STDERR, f"{sentence}\n".encode())

    # write on a thread, because a terminal stopped by Ctrl-S accepts no text
    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    writer.join(SAY_S)


def _tell(word: str, value: Any = None) -> None:
    try:
        os.write(STDOUT, messages.line(word, value))
    except OSError:
        # the run has ended or hangs, so it cannot receive this line
        return


def _parent() -> int | None:
    """Return a descriptor that becomes readable when the process of the run ends, or None if the system has
    none."""
    try:
        return os.pidfd_open(os.getppid())
    except OSError:
        return None


if __name__ == "__main__":
    main()
