"""Readings of gauges that are appended to a file image by image, so that a killed command goes on with it."""

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from dic.errors import OutputError
from dic.files.lock import lock_descriptor
from dic.files.writing import reason
from dic.gauges.declared import Gauge
from dic.gauges.reading import Profile, Reading, SharedPart
from dic.gauges.series import GaugeImage, declaration
from dic.results.provenance import versions

COMMIT_IMAGES = 64
"""Number of images after which the readings are forced to the disk."""


class KeptReadings:
    """The file of the readings that are finished; use it in a `with` statement.

    Each line is the JSON of one image, in the order in which they are read. The first line tells what was
    read; a file of other results or gauges is begun anew. A line that a killed program has not finished is
    cut off. The file is removed when `done` was called.

    `path`: the file. `results`: the result file. `gauges`, `camera`: as for `measure_gauges`.

    Raises `OutputError` if the file cannot be written, or another program writes it.
    """

    def __init__(self, path: Path, results: Path, gauges: Sequence[Gauge], camera: str | None) -> None:
        self.path, self._new, self._done = path, 0, False
        about = results.stat() if results.exists() else None
        job = {
            "results": [
                str(results.resolve()),
                *([] if about is None else [about.st_size, about.st_mtime_ns]),
            ],
            "gauges": [declaration(gauge) for gauge in gauges],
            "camera": camera,
            "versions": versions(),
        }
        head = json.dumps(job).encode() + b"\n"
        self._head = len(head)
        try:
            self._file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o644), "r+b")
            lock_descriptor(self._file.fileno())
            if self._file.readline() != head:
                self._file.seek(0)
                self._file.truncate()
                self._file.write(head)
        except OSError as error:
            raise self._refused(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        empty = self._file.seek(0, os.SEEK_END) == self._head
        self._file.close()
        if self._done or empty:
            self.path.unlink(missing_ok=True)

    def finished(self) -> Iterator[GaugeImage]:
        """Yield the images that are finished; call this once, before images are added."""
        end = self._file.tell()
        while (line := self._file.readline()).endswith(b"\n"):
            end = self._file.tell()
            yield _image(json.loads(line))
        self._file.seek(end)
        self._file.truncate()

    def add(self, image: GaugeImage) -> None:
        """Append the readings of the next image.

        Raises `OutputError` if the disk is full.
        """
        try:
            self._file.write(json.dumps(_plain(image), ensure_ascii=False).encode() + b"\n")
            self._file.flush()
            self._new += 1
            if self._new % COMMIT_IMAGES == 0:
                os.fsync(self._file.fileno())
        except OSError as error:
            raise self._refused(error) from error

    def done(self) -> None:
        """Let the file be removed, because the readings are in the files that the user wants."""
        self._done = True

    def _refused(self, error: OSError) -> OutputError:
        expected, remedy = "a folder with room, and no other program", "make room, and give the command again"
        return OutputError(str(self.path), "keep readings of gauges", expected, reason(error), remedy)


def _plain(image: GaugeImage) -> dict[str, Any]:
    """Return the readings of an image for JSON, which keeps all bits of numbers and NaN."""
    readings = {
        gauge: {kind: {type(one).__name__: _of_object(one)} for kind, one in own.items()}
        for gauge, own in image.readings.items()
    }
    return vars(image) | {"readings": readings, "known": _numbers(image.known)}


def _of_object(one: Any) -> dict[str, Any]:
    return {
        name: _of_object(value) if isinstance(value, SharedPart) else _numbers(value)
        for name, value in vars(one).items()
    }


def _numbers(value: Any) -> Any:
    """Return a value with numbers of Python instead of those of NumPy."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if hasattr(value, "items"):
        return {name: _numbers(each) for name, each in value.items()}
    return value


def _image(found: dict[str, Any]) -> GaugeImage:
    readings = {
        gauge: {kind: _reading(*next(iter(one.items()))) for kind, one in own.items()}
        for gauge, own in found["readings"].items()
    }
    return GaugeImage(**found | {"readings": readings})


def _reading(kind: str, found: dict[str, Any]) -> Reading | Profile:
    if kind == "Reading":
        shared = found["shared"]
        if shared is not None:
            covariance, weights = np.array(shared["covariance"]), np.array(shared["weights"])
            # Without any cause, the list does not tell that the array has three rows.
            found["shared"] = SharedPart(covariance, weights, np.array(shared["mounting"]).reshape(3, -1))
        return Reading(**found)
    arrays = {name: np.array(found[name]) for name in ("distance", "points", "declared")}
    values = {name: np.array(each, np.float64) for name, each in found["values"].items()}
    return Profile(**found | arrays | {"values": values})
