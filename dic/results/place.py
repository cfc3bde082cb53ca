"""The place of a result file, and what a measurement may do with the results that are there."""

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from dic.errors import OutputError
from dic.files.lock import lock_file
from dic.files.writing import reason
from dic.hdf5.open import NotReadable, open_hdf5
from dic.results.schema import FINISHED, OUTPUTS
from dic.typing import PathLike


@dataclass(frozen=True)
class ResultPlace:
    """The place of a result file, and what may be done with earlier results.

    Attributes
    ----------
    path : Path
        The result file. If it already contains the same results, it is not written again.
    replace : bool
        True if other results at this place may be replaced.
    fields_from : Path, optional
        A result file whose fields are used instead of a correlation. Default: `path`, if it contains the
        fields of this measurement.
    inputs : tuple of Path
        Files from which the caller took settings, such as a settings file. The provenance of the results
        names these files with their digests.
    outputs : tuple of Path
        Other files that the caller writes. If the measurement is interrupted, `outputs_of` returns them.
    """

    path: Path
    replace: bool = True
    fields_from: Path | None = None
    inputs: tuple[Path, ...] = ()
    outputs: tuple[Path, ...] = ()


@contextmanager
def result_place(output: PathLike | None) -> Iterator[Path]:
    """Provide the path of the result file, or a temporary path if the user wants no result file."""
    if output is not None:
        yield Path(output)
        return
    # Ignore errors, because some systems cannot remove an open file. They remove temporary files later.
    with TemporaryDirectory(prefix="offaxis-", ignore_cleanup_errors=True) as folder:
        yield Path(folder) / "results.h5"


@contextmanager
def alone(result: Path | None) -> Iterator[None]:
    """Lock the place of a result file against other programs that write it; without one, do nothing.

    The lock is a hidden file beside the result file, which is removed at the end. Files that killed programs
    have left unpublished are removed.

    Raises `OutputError` if another program writes this result file, or the folder cannot be written to.
    """
    if result is None:
        yield
        return
    place = Path(os.path.realpath(result))
    beside = place.with_name(f".{place.name}.lock")
    try:
        lock = lock_file(beside)
    except BlockingIOError as error:
        expected, got = "a result file of its own", "one that another program is measuring into"
        remedy = "wait until that program has ended, or name another file"
        raise OutputError(str(result), "write results", expected, got, remedy) from error
    except OSError as error:
        expected, remedy = "a folder that can be written to", "name another file"
        raise OutputError(str(result), "lock results", expected, reason(error), remedy) from error
    try:
        _remove_abandoned(place)
        yield
    finally:
        beside.unlink(missing_ok=True)
        os.close(lock)


def _remove_abandoned(result: Path) -> None:
    """Remove the unpublished files of programs that were killed before the first results were in the file."""
    for partial in result.parent.glob(f".{escape(result.name)}.*.partial"):
        # A program that still writes its file holds a lock on it.
        with suppress(OSError):
            os.close(lock_file(partial))
            partial.unlink()


def outputs_of(result: Path) -> list[Path]:
    """Return the files that an interrupted measurement into `result` may have written, with `result` itself.

    The list is empty if there is no interrupted measurement.
    """
    try:
        if not result.exists():
            return []
        with open_hdf5(result) as file:
            if file.attrs.get(FINISHED, 1):
                return []
            return [result.resolve(), *map(Path, json.loads(file["provenance"].attrs[OUTPUTS]))]
    except (NotReadable, OSError, KeyError, ValueError):
        # Whoever uses this file gives the reason.
        return []


def outputs_text(outputs: Iterable[Path]) -> str:
    """Return the text from which `outputs_of` reads the other files of a measurement."""
    return json.dumps([os.path.realpath(path) for path in outputs])
