"""The two files beside a run file: a file of all events, and the heartbeat for other programs."""

import json
import os
import stat
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.clock import SystemClock
from rig.errors import RecordingError
from rig.news.bulletin import Bulletin, text_of

BEAT_S = 1.0
"""Shortest time in s between two updates of the heartbeat file."""
STALE_S = 10.0
"""If the heartbeat is older than this time in s, the run hangs or was killed."""
STALE_ENDING_S = 120.0
"""Largest age of the heartbeat in s while a run ends. The safe state takes up to 15 s, closing the file
longer."""


def events_path(run_path: Path) -> Path:
    """Return the path of the file of events that belongs to a run file."""
    return run_path.with_suffix(".events.jsonl")


def heartbeat_path(run_path: Path) -> Path:
    """Return the path of the heartbeat file that belongs to a run file."""
    return run_path.with_suffix(".heartbeat.json")


class _Follower(threading.Thread, ABC):
    """A thread that writes a news file. `failure` says why writing failed, or is empty without a failure."""

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self.path = path
        self.failure = ""

    def run(self) -> None:
        try:
            self._follow()
        except OSError as error:
            self.failure = f"{self.path}: {error.strerror or error}; it is not written any more"
        except Exception as error:
            self.failure = f"{self.path}: {type(error).__name__} ({error}); it is not written any more"

    @abstractmethod
    def _follow(self) -> None:
        """Write until the end of the run."""

    def finish(self, timeout_s: float) -> list[str]:
        """Wait for the last write, and return the error message of a failed write."""
        self.join(timeout_s)
        if self.is_alive():
            return [f"{self.path}: the disk did not answer within {timeout_s:g} s; the end is missing"]
        return [self.failure] if self.failure else []


class EventFile(_Follower):
    """Appends every event of a bulletin to a file, one JSON object per line.

    New events are appended to an existing file. Each line contains the identity of its run. Raise
    `RecordingError` if the file cannot be written, or is no regular file.
    """

    def __init__(self, path: Path, bulletin: Bulletin) -> None:
        super().__init__(path, "file of events")
        self._bulletin = bulletin
        try:
            # Refuse pipes, which could block without a reader, and links, which could lead to any other file.
            flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            descriptor = os.open(path, flags, 0o666)
        except OSError as error:
            raise _cannot_write(path, error.strerror or str(error)) from error
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise _cannot_write(path, "a folder, a pipe or a device")
        self._file = os.fdopen(descriptor, "ab", buffering=0)

    def close(self) -> None:
        """Close the file of events if the run could not begin."""
        self._file.close()

    def _follow(self) -> None:
        place = 0
        with self._file:
            while True:
                self._bulletin.wait_for(place, BEAT_S)
                closed = self._bulletin.closed
                for event in self._bulletin.since(place):
                    self._write(json.dumps(event, allow_nan=False).encode() + b"\n")
                    place = event["n"]
                if closed and place >= self._bulletin.last:
                    return

    def _write(self, line: bytes) -> None:
        while line:
            line = line[self._file.write(line) or 0 :]


class Heartbeat(_Follower):
    """Replaces a small file whenever the run has made progress, at most once per second.

    `content` returns the content of the file, which includes the engine's latest status. Raise
    `RecordingError` if the path exists and is not a regular file.
    """

    def __init__(self, path: Path, content: Callable[[], dict[str, Any]]) -> None:
        super().__init__(path, "heartbeat file")
        if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
            raise _cannot_write(path, "a link, a folder, a pipe or a device")
        self._content = content
        self._clock = SystemClock()
        self._changed = threading.Event()
        self._ending = threading.Event()

    def beat(self) -> None:
        """Record that the run has made progress. The file is then written again."""
        self._changed.set()

    def end(self) -> None:
        """Write the heartbeat file for the last time."""
        self._ending.set()
        self._changed.set()

    def _follow(self) -> None:
        while True:
            self._changed.wait()
            self._changed.clear()
            ending = self._ending.is_set()
            self._write()
            if ending:
                return
            self._ending.wait(BEAT_S)

    def _write(self) -> None:
        content = {**self._content(), "utc": text_of(self._clock.utc()), "pid": os.getpid()}
        partial = self.path.with_name(f".{self.path.name}.{os.getpid()}.partial")
        try:
            # The heartbeat is not synchronised with the disk, because it is useless after a power failure.
            partial.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")
            partial.replace(self.path)
        except OSError:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
            raise


def _cannot_write(path: Path, got: str) -> RecordingError:
    return RecordingError(
        str(path), "a file that can be written", got, "move it away, or name another run file with -o"
    )
