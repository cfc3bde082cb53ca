"""Where `rig watch` reads what a run tells: its heartbeat file, or its HTTP interface. Both are only read."""

import http.client
import json
import os
import socket
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from dic.files.reading import read_bytes, require_regular
from drivers.clock import Clock
from rig import RigError
from rig.news.files import heartbeat_path
from rig.news.told import ToldRun, told_run

HTTP_S = 5.0
"""Longest time in s for an answer of the HTTP interface."""
MOST_BYTES = 64 << 20
"""A heartbeat has some ten thousand bytes. A file of more than this is none."""
_ENDING = ".heartbeat.json"
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_BLOCKS = (0, *(512 << k for k in range(16)))
"""Where the signature of an HDF5 file may stand, behind a block of the program that made it."""


@dataclass(frozen=True)
class Seen:
    """What a run told at last, and how many seconds ago. `lost` says why it cannot be asked any more."""

    run: ToldRun
    age_s: float
    lost: str = ""


class Source(Protocol):
    """Reads what a run tells. `name` is for people."""

    name: str

    def read(self) -> Seen:
        """Return what the run told at last. Raise `RigError` if there are no news of a run."""


def find_source(target: str, clock: Clock) -> Source:
    """Return the source of the news of a run: its file, its folder, or the address of its HTTP interface.

    Raise `RigError` if nothing of this kind is there.
    """
    if "://" in target:
        return HttpSource(target, clock)
    return FileSource(find_heartbeat(Path(target)), clock)


def find_heartbeat(path: Path) -> Path:
    """Return the heartbeat file of a run file; of a folder, the one that was written last.

    Raise `RigError` with the reason if there is none.
    """
    if path.is_dir():
        found = sorted(path.glob(f"*{_ENDING}"), key=lambda each: each.stat().st_mtime)
        if not found:
            raise RigError(
                str(path), "a folder with a run", "one without a heartbeat file", "name the run file"
            )
        return found[-1]
    beside = path if path.suffix == ".json" else heartbeat_path(path)
    if beside.exists():
        return beside
    if not path.exists():
        raise RigError(
            str(path),
            "a run file with its heartbeat file",
            "no such file",
            "name the file of -o of rig run, which writes both when it begins",
        )
    if not _is_hdf5(path):
        raise RigError(str(path), "a run file", "another file", "name the file of -o of rig run")
    raise RigError(
        str(path),
        f"the heartbeat file {beside.name} beside it",
        "none",
        "keep both files in one folder; rig verify tells what is in a run file",
    )


def _is_hdf5(path: Path) -> bool:
    try:
        require_regular(path)
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            for place in (place for place in _BLOCKS if place < size):
                file.seek(place)
                if file.read(len(_SIGNATURE)) == _SIGNATURE:
                    return True
    except OSError as error:
        raise RigError(
            str(path), "a file that can be read", error.strerror or str(error), "check its rights"
        ) from error
    return False


class FileSource:
    """Reads the heartbeat file of a run, which the run replaces as a whole."""

    def __init__(self, path: Path, clock: Clock) -> None:
        self.name = str(path)
        self._path, self._clock = path, clock

    def read(self) -> Seen:
        """Return the content of the file, and how long ago it was written."""
        seen = self._seen()
        # the program of a run may have written its last words and ended between the two looks at it
        return self._seen() if seen.lost else seen

    def _seen(self) -> Seen:
        try:
            content = read_bytes(self._path, MOST_BYTES)
        except OSError as error:
            raise RigError(
                self.name, "a file that can be read", error.strerror or str(error), "name the run file"
            ) from error
        run = told_run(_parsed(content), self.name)
        if run.utc is None:
            raise RigError(self.name, "the time of the heartbeat", "none", "name the run file")
        age_s = (self._clock.utc() - run.utc).total_seconds()
        return Seen(run, max(0.0, age_s), "" if run.ended else _gone(run))


def _gone(run: ToldRun) -> str:
    """Return that the program of a run on this computer has ended, or an empty text."""
    if run.pid <= 0 or run.host != socket.gethostname():
        return ""
    try:
        os.kill(run.pid, 0)  # this only asks whether there is such a process
    except ProcessLookupError:
        return f"its program (process {run.pid}) is gone and has not said how the run ended: it was killed"
    except (PermissionError, OverflowError):
        return ""
    return ""


class HttpSource:
    """Asks the HTTP interface of a run for its status."""

    def __init__(self, url: str, clock: Clock) -> None:
        parts = urlsplit(url)
        if parts.scheme != "http" or not parts.hostname:
            raise RigError(url, "an address http://127.0.0.1:PORT", "another one", "see what rig run printed")
        self.name = f"http://{parts.netloc}"
        self._url = f"{self.name}/v1/status"
        # no proxy: the interface answers programs of its own computer, or through a tunnel
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        self._clock = clock
        self._last: ToldRun | None = None

    def read(self) -> Seen:
        """Return the status. If the interface does not answer any more, return the last one."""
        try:
            with self._opener.open(self._url, timeout=HTTP_S) as answer:
                content = answer.read(MOST_BYTES + 1)
        except urllib.error.HTTPError as error:
            raise RigError(self.name, "the status of a run", _refusal(error), _HTTP_REMEDY) from error
        except (OSError, http.client.HTTPException, ValueError) as error:
            reason = getattr(error, "reason", None) or error
            if self._last is not None:
                return self._at_end(self._last, f"{self.name} does not answer any more ({reason})")
            raise RigError(self.name, "an answer of a run", str(reason), _HTTP_REMEDY) from error
        self._last = run = told_run(_parsed(content), self.name)
        return Seen(run, run.age_s)

    def _at_end(self, last: ToldRun, lost: str) -> Seen:
        """Return how the run ended by its heartbeat file, if it is on this computer."""
        beside = heartbeat_path(Path(last.run_file))
        try:
            seen = FileSource(beside, self._clock).read()
        except RigError:
            return Seen(last, 0.0, lost)
        return seen if seen.run.run_id == last.run_id else Seen(last, 0.0, lost)


_HTTP_REMEDY = "name the address that rig run --http printed, or watch the run file"


def _refusal(error: urllib.error.HTTPError) -> str:
    with error:
        table = _parsed(error.read(MOST_BYTES))
    said = table.get("error") if isinstance(table, dict) else None
    return f"status {error.code}" + (f" ({said})" if said else "")


def _parsed(content: bytes) -> Any:
    """Return the value of a JSON text, or None if it is none."""
    if len(content) > MOST_BYTES:
        return None
    try:
        return json.loads(content)
    except (ValueError, RecursionError):
        return None
