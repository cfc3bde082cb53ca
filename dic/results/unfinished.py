"""Keeps the finished images of an unfinished measurement in a folder beside the result file.

Correlation takes most of the time of a measurement. So the fields of each image are written to a file of
their own as soon as the image is correlated. The file appears under its name only when it is complete and on
the disk. If the program is killed, no finished image is lost. When it is started again, it continues after
the last finished image. The result file is made from the same fields, and the folder is removed when the
result file is complete.
"""

import hashlib
import json
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from dataclasses import field as dataclass_field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dic.correlation.field import Field
from dic.correlation.series_state import SeriesFields
from dic.errors import OutputError
from dic.files.lock import lock_file
from dic.files.reading import read_text
from dic.files.writing import reason, replacing, write_text
from dic.image.times import ImageTime
from dic.results.job import Outcome, as_text
from dic.typing import Float, PathLike

ENDING = ".unfinished"

_JOB, _OUTPUTS, _LOCK = "job.json", "outputs.json", "lock"
_UNREADABLE = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile)
_PLAIN = ("label", "digest", "failure")
_NOT_STORED = {"settings", "region", "grid"}
"""Attributes of a field that are equal in all fields of a series, and so are not stored for each image."""


@dataclass(frozen=True)
class FinishedImage:
    """The outcome of the correlation of an image.

    Attributes
    ----------
    label : str
        Name of the image.
    digest : str
        SHA-256 of the image's file, or of its frames; "" if it is not known.
    fields : SeriesFields or None
        None if the image could not be correlated.
    failure : str or None
        The reason why the image could not be correlated.
    content : str
        The result of `dic.results.job.content_of`; "" if it is not known.
    time : ImageTime
        When the image was taken. The time is not written to the folder of finished images.
    """

    label: str
    digest: str = ""
    fields: SeriesFields | None = None
    failure: str | None = None
    content: str = ""
    time: ImageTime = dataclass_field(default_factory=ImageTime)

    @property
    def outcome(self) -> Outcome:
        """What a result file stores about the image in addition to the image's fields."""
        return Outcome(self.label, self.content, self.failure, self.time)

    @property
    def field(self) -> Field:
        """The field from the first reference to the image."""
        if self.fields is None:
            raise ValueError(f"{self.label} could not be correlated")
        return self.fields.from_first

    def key(self, hint: Float | None) -> str:
        """Return a text that identifies the image and its first guess within a series."""
        expected = b"" if hint is None else np.ascontiguousarray(hint, np.float64).tobytes()
        return hashlib.sha256(f"{self.label}\0{self.digest}\0".encode() + expected).hexdigest()


class FinishedImages:
    """The finished images of one series, in a folder with one file for each image.

    Parameters
    ----------
    folder : Path
        The folder is made when the first image is written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, number: int, key: str, image: FinishedImage) -> None:
        """Write an image.

        Parameters
        ----------
        number : int
            Number of the image in the series.
        key : str
            The result of `FinishedImage.key`.
        image : FinishedImage

        Raises
        ------
        OutputError
            If the disk is full, or the file cannot be written for another reason.
        """
        plain: dict[str, Any] = {"key": key} | {name: getattr(image, name) for name in _PLAIN}
        arrays: dict[str, Any] = {}
        if image.fields is not None:
            known = vars(image.fields)
            if image.fields.from_current is image.fields.from_first:
                known = {"from_first": image.fields.from_first}
            for name, field in known.items():
                plain[name], arrays_of = _parts(field)
                arrays |= {f"{name} {own}": values for own, values in arrays_of.items()}
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with replacing(self._path(number)) as partial, partial.open("wb") as file:
                np.savez(file, plain=np.array(json.dumps(plain)), **arrays)
        except OSError as error:
            raise _not_written(self._folder, error) from error

    def find(self, number: int, key: str, shared: Mapping[str, Any]) -> FinishedImage | None:
        """Return an image with its fields; None if it is not finished, or has another key.

        If the result is None, this image and all later images are removed, because the correlation of a later
        image may have begun from the old fields of this image.

        Parameters
        ----------
        number : int
            Number of the image in the series.
        key : str
            The result of `FinishedImage.key`.
        shared : mapping of str to object
            The attributes that all fields of the series share: `Series.shared`.
        """
        try:
            found, found_key = self._read(number, shared)
            if found_key == key:
                return found
        except FileNotFoundError:
            pass
        except _UNREADABLE:
            # A power failure can damage the file of an image. Then the image is correlated again.
            pass
        self._remove_from(number)
        return None

    def read(self, number: int, shared: Mapping[str, Any]) -> FinishedImage:
        """Return an image that is known to be finished; see `find` for the arguments.

        Raises
        ------
        OutputError
            If the file of the image was removed or damaged since it was written.
        """
        try:
            return self._read(number, shared)[0]
        except _UNREADABLE as error:
            raise OutputError(
                str(self._path(number)),
                "read finished image",
                "the image that this program has written",
                str(error) or type(error).__name__,
                "give the same command again, and leave the folder to the program",
            ) from error

    def _read(self, number: int, shared: Mapping[str, Any]) -> tuple[FinishedImage, str]:
        with np.load(self._path(number), allow_pickle=False) as stored:
            plain = json.loads(str(stored["plain"]))
            image = FinishedImage(**{name: plain[name] for name in _PLAIN})
            if "from_first" in plain:
                first = current = self._field("from_first", plain, stored, shared)
                if "from_current" in plain:
                    # Only the displacements of this field are used, as the first guess for the next image.
                    alone = {"settings": shared["settings"]}
                    current = self._field("from_current", plain, stored, alone)
                image = replace(image, fields=SeriesFields(first, current))
            return image, plain["key"]

    def _field(self, name: str, plain: Mapping[str, Any], stored: Any, shared: Mapping[str, Any]) -> Field:
        start, values = f"{name} ", dict(plain[name])
        values["greatest_bias_px"] = tuple(values["greatest_bias_px"])
        values |= {key.removeprefix(start): stored[key] for key in stored if key.startswith(start)}
        return Field(**values, **shared)

    def _remove_from(self, number: int) -> None:
        # Remove the last image first. If the program is killed meanwhile, no image remains after a removed
        # image.
        for path in sorted(self._folder.glob("*.npz"), reverse=True):
            if int(path.stem) >= number:
                path.unlink()

    def _path(self, number: int) -> Path:
        return self._folder / f"{number:08d}.npz"


def _parts(field: Field) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return two dicts: the attributes of a field that are not arrays, and those that are arrays."""
    values = {item.name: getattr(field, item.name) for item in fields(field) if item.name not in _NOT_STORED}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    return {name: value for name, value in values.items() if name not in arrays}, arrays


@dataclass
class Unfinished:
    """The folder of a measurement's finished images, while the measurement is going on.

    Attributes
    ----------
    folder : Path
    stays : bool
        True if the measurement was stopped, so that the folder stays when the program ends.
    """

    folder: Path
    stays: bool = False

    def series(self, number: int) -> FinishedImages:
        """Return the finished images of the series with the given number."""
        return FinishedImages(self.folder / f"series_{number}")


@contextmanager
def unfinished(result: Path, job: Mapping[str, Any], outputs: Iterable[Path] = ()) -> Iterator[Unfinished]:
    """Give the folder of a measurement's finished images, and lock the result file against other programs.

    The folder stays if the `with` block raises an error, so that the measurement can go on later. At the end
    of the block, when the result file is complete, the folder is removed. Every job has a folder of its own,
    so a measurement with other settings removes no finished images.

    Parameters
    ----------
    result : Path
        The result file of the measurement. The folder of finished images is made beside this file.
    job : mapping
        Everything except the images that determines the results, as values for JSON.
    outputs : iterable of Path
        The other files that the measurement writes.

    Raises
    ------
    OutputError
        If another program measures into the same result file, or the folder cannot be made.
    """
    text = as_text(job)
    folder = _folder(result) / hashlib.sha256(text.encode()).hexdigest()[:16]
    with alone(result):
        try:
            try:
                folder.mkdir(exist_ok=True)
                write_text(folder / _JOB, text)
                paths = [os.path.realpath(path) for path in (result, *outputs)]
                write_text(folder / _OUTPUTS, json.dumps(paths, indent=1))
            except OSError as error:
                raise _not_written(folder, error) from error
            work = Unfinished(folder)
            yield work
            if not work.stays:
                shutil.rmtree(folder)
        finally:
            if folder.exists() and not any(path.is_dir() for path in folder.iterdir()):
                shutil.rmtree(folder)


@contextmanager
def alone(result: Path | None) -> Iterator[None]:
    """Lock a result file against other programs that write it; without a result file, do nothing.

    The lock is a file in the folder of finished images, which is removed at the end if it has no images.

    Raises
    ------
    OutputError
        If another program writes this result file, or the folder cannot be made.
    """
    if result is None:
        yield
        return
    every = _folder(result)
    try:
        every.mkdir(exist_ok=True)
        lock = lock_file(every / _LOCK)
    except BlockingIOError as error:
        expected, got = "a result file of its own", "one that another program is measuring into"
        remedy = "wait until that program has ended, or name another file"
        raise OutputError(str(result), "write results", expected, got, remedy) from error
    except OSError as error:
        expected, remedy = "a folder that can be written to", "name another file"
        raise OutputError(str(result), "lock results", expected, reason(error), remedy) from error
    try:
        yield
    finally:
        if [path.name for path in every.iterdir()] == [_LOCK]:
            shutil.rmtree(every)
        os.close(lock)


def outputs_of(result: Path) -> list[Path]:
    """Return the files that interrupted measurements into `result` may have written, often an empty list."""
    found = []
    for path in _folder(result).glob(f"*/{_OUTPUTS}"):
        try:
            found += [Path(name) for name in json.loads(read_text(path))]
        except (OSError, ValueError):
            # The program was killed at its start, before it had written any output.
            continue
    return found


@contextmanager
def result_place(output: PathLike | None) -> Iterator[Path]:
    """Provide the path of the result file, or a temporary path if the user wants no result file."""
    if output is not None:
        yield Path(output)
        return
    # Ignore errors, because some systems cannot remove an open file. They remove temporary files later.
    with TemporaryDirectory(prefix="offaxis-", ignore_cleanup_errors=True) as folder:
        yield Path(folder) / "results.h5"


def _folder(result: Path) -> Path:
    place = Path(os.path.realpath(result))
    return place.with_name(place.name + ENDING)


def _not_written(folder: Path, error: OSError) -> OutputError:
    remedy = "make room, and give the same command again to go on after the last finished image"
    return OutputError(
        str(folder), "keep finished images", "a disk with room for them", reason(error), remedy
    )
