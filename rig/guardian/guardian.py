"""Start the guardian before anything moves, send it signs of progress, and check that it is alive."""

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import drivers.errors
from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.registry import GUARD_STOP_MAX_S
from rig.errors import RigError
from rig.guardian import messages
from rig.guardian.machines import watched
from rig.rigfile import RigFile
from rig.threads import still_running

# Option -P: do not import packages from the user's folder, which may have the name of an offaxis package.
COMMAND = (sys.executable, "-P", "-m", "rig.guardian.process")
START_S = 30.0
END_S = 8.0
PING_S = 0.1


class Guardian:
    """The run's connection to its guardian process. There is no process if no machine needs a guardian.

    `relays` has for each watched machine ``host:port`` of the guardian's relay, or an empty text.
    `silence_max_s` is the time without an answer after which the guardian counts as dead.
    """

    def __init__(
        self, process: "subprocess.Popen[bytes] | None", relays: dict[str, str], silence_max_s: float
    ) -> None:
        self.relays = relays
        self.moved = False
        self._process = process
        self._silence_max_s = silence_max_s
        self._clock = SystemClock()
        self._closing = False
        self._trouble = ""
        self._answered_s = self._clock.now_s()
        self._watcher: threading.Thread | None = None
        if process is not None:
            os.set_blocking(_pipe(process.stdin).fileno(), False)

    @property
    def pid(self) -> int | None:
        """Number of the guardian's process, for tests and messages, or None without a guardian."""
        return None if self._process is None else self._process.pid

    def progress(self, moving: bool) -> None:
        """Tell the guardian that all devices were read without an error, and whether one of them may be
        moving."""
        self._send(messages.MOVING if moving else messages.STANDING)
        if self._process is not None:
            still_running()

    def about_to_move(self) -> None:
        """Tell the guardian that a motion command will be sent now."""
        self.moved = True
        self._send(messages.MOVING)

    def waiting_for_a_person(self) -> None:
        """Tell the guardian that everything stands still and that the next reading may take long."""
        self._send(messages.WAITING)

    @contextmanager
    def watched(self, on_trouble: Callable[[str], None]) -> Iterator[None]:
        """Watch the guardian. If it dies, hangs or stops a machine, call `on_trouble` once on another thread.

        A guardian that does not answer, or that begins no new attempt to stop a machine, is killed before
        this call, so that the run can use its lines to stop. A guardian that goes on trying is left alone.
        """
        if self._process is None:
            yield
            return
        self._watcher = threading.Thread(
            target=self._watch, args=(self._process, on_trouble), name="watch the guardian", daemon=True
        )
        self._answered_s = self._clock.now_s()
        self._watcher.start()
        yield

    def done(self) -> None:
        """End the guardian without a stop, because all machines are known to stand still."""
        self._send(messages.DONE)
        self.close()

    def close(self) -> None:
        """End the guardian. If `done` was not called, the guardian first stops every machine."""
        self._closing = True
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(OSError):
            _pipe(process.stdin).close()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            # let the guardian run on, because it still tries to stop a machine that has not confirmed its
            # stop
            return
        finally:
            if self._watcher is not None:
                self._watcher.join(END_S)
            _pipe(process.stdout).close()

    def _send(self, sign: bytes) -> None:
        process = self._process
        if process is not None:
            # Ignore errors and never wait here, because `_watch` notices a guardian that has ended or hangs.
            with contextlib.suppress(OSError, ValueError):
                os.write(_pipe(process.stdin).fileno(), sign)

    def _watch(self, process: "subprocess.Popen[bytes]", on_trouble: Callable[[str], None]) -> None:
        lines = messages.Lines(_pipe(process.stdout).fileno())
        told = over = False
        next_s = self._clock.now_s()
        while not (self._closing or over):
            # The answer comes at once. Another question at once would keep both processes busy all the time.
            if (left_s := next_s - self._clock.now_s()) <= 0.0:
                self._send(messages.PING)
                left_s, next_s = PING_S, self._clock.now_s() + PING_S
            try:
                said = lines.next(left_s)
                silent_s = self._clock.now_s() - self._answered_s
                if said is None and silent_s > self._silence_max_s:
                    # check once more for an answer, because this thread itself may have been delayed
                    said = lines.next(0.0)
            except (EOFError, OSError):
                trouble, over = "the guardian died", True
            else:
                trouble = self._hangs(said)
                over = bool(trouble)
                if over:
                    process.kill()
                trouble = trouble or _trouble(said)
            if trouble and not (told or self._closing):
                told = True
                on_trouble(f"{trouble}: the run is not guarded any more")

    def _hangs(self, said: tuple[str, Any] | None) -> str:
        """Return why the guardian, which has given this answer, hangs, or an empty text."""
        if said is None:
            silent = self._clock.now_s() - self._answered_s > self._silence_max_s
            return f"the guardian did not answer for {self._silence_max_s:g} s" if silent else ""
        self._answered_s = self._clock.now_s()
        word, ages_s = said
        late = (
            [name for name, age_s in (ages_s or {}).items() if age_s > GUARD_STOP_MAX_S]
            if word == messages.ALIVE
            else []
        )
        return f"the guardian's stop of {' and '.join(late)} hangs" if late else ""


def _trouble(said: tuple[str, Any] | None) -> str:
    """Return the problem that an answer of the guardian means, or an empty text."""
    word, value = said or ("", None)
    if word == messages.LOST:
        return f"the guardian cannot reach a machine any more ({value})"
    return f"the guardian had to stop the machines ({value})" if word == messages.STOPPED else ""


@contextmanager
def guarded(rig_file: RigFile, locks: Sequence[int], log: Path) -> Iterator[Guardian]:
    """Start the guardian of a run, yield when it has reached each machine, and end it afterwards.

    If `Guardian.done` was not called in the block, the guardian stops the machines at the end, unless nothing
    has moved.

    The guardian shares `locks`, the descriptors of the machines' locks, and writes into the file `log` what
    it has done. Raise `DeviceError` if the guardian cannot reach a machine, and `RigError` if it does not
    start.
    """
    guardian = _start(rig_file, locks, log)
    try:
        yield guardian
    finally:
        if guardian.moved:
            guardian.close()
        else:
            guardian.done()


def _start(rig_file: RigFile, locks: Sequence[int], log: Path) -> Guardian:
    entries = watched(rig_file)
    times = rig_file.guardian
    if not entries:
        return Guardian(None, {}, times.silence_max_s)
    job = {
        "machines": [
            {
                "name": entry.name,
                "driver": entry.driver,
                "settings": entry.settings.model_dump(mode="json", exclude_unset=True),
            }
            for entry in entries
        ],
        "patience_s": times.patience_s,
        "standing_patience_s": times.standing_patience_s,
        "log": str(log.absolute()),
        "locks": list(locks),
    }
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        COMMAND, stdin=pipe, stdout=pipe, bufsize=0, start_new_session=True, pass_fds=locks
    )
    try:
        _pipe(process.stdin).write(json.dumps(job).encode() + b"\n")
        return Guardian(process, _relays(process), times.silence_max_s)
    except BaseException:
        # nothing has moved, so the guardian need not stop anything
        process.kill()
        process.communicate()
        raise


def _relays(process: "subprocess.Popen[bytes]") -> dict[str, str]:
    """Wait until the guardian has reached each machine, and return its relays."""
    try:
        said = messages.Lines(_pipe(process.stdout).fileno()).next(START_S)
    except EOFError:
        said = None
    if said is None:
        raise RigError(
            "starting the guardian",
            f"a guardian that has reached each machine within {START_S:g} s",
            "none",
            f"try it alone, to see why: {' '.join(COMMAND)} < /dev/null",
        )
    word, value = said
    if word == messages.READY:
        return dict(value)
    kind, *texts = value
    if kind:
        raise getattr(drivers.errors, kind, DeviceError)(*texts)
    raise RigError("starting the guardian", "each machine within reach", texts[0], "check the driver's guard")


def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
    assert pipe is not None  # `Popen` has made this pipe, because pipes for both directions were requested
    return pipe
