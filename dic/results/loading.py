"""Open and read result files, and refuse a damaged file in one sentence."""

import re
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from dic.errors import MeasurementError, RunFileError
from dic.hdf5.open import NotReadable, open_hdf5
from dic.results.schema import VERSION
from dic.results.shapes import Contradiction

Result = TypeVar("Result")

_WRITER = re.compile(r"\boffaxis [\w.+!]+")


def use_result(path: Path, use: Callable[[Any], Result], refusal: Callable[[Path, str], Exception]) -> Result:
    """Call `use` with the open file, close the file, and return the result of `use`."""

    def closing(file: Any) -> Result:
        with file:
            return use(file)

    return load_result(path, closing, refusal)


def load_result(
    path: Path, read: Callable[[Any], Result], refusal: Callable[[Path, str], Exception]
) -> Result:
    """Call `read` with the open file, and return the result of `read`; the file stays open.

    For a damaged file, or a file that contradicts itself, the error that `refusal` returns is raised. An
    `OSError` that names a file, which `read` cannot write, passes unchanged. The function `read` must access
    every value once. Then a file that lacks a value is refused now, and not in the middle of a report.
    """
    try:
        file = open_hdf5(path)
        try:
            return read(file)
        except BaseException:
            file.close()
            raise
    except (NotReadable, Contradiction) as error:
        raise refusal(path, str(error)) from error
    except MeasurementError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            # An error of another file, which `read` writes. Errors of HDF5 have no file name.
            raise
        # A damaged file can cause any exception here. The `try` block only reads the file.
        raise refusal(path, f"a result file that lacks some of its data ({type(error).__name__})") from error


def require_version(path: Path, file: Any) -> None:
    """Raise an error if the open result file has a format that this program does not know.

    Raises
    ------
    RunFileError
        Names the version of offaxis that wrote the file.
    """
    found = file.attrs["file_format_version"]
    if found == VERSION:
        return
    origin = file.get("provenance")
    said = _WRITER.search("" if origin is None else str(origin.attrs.get("versions", "")))
    writer = said[0] if said else "an unknown version of offaxis"
    raise RunFileError(
        str(path),
        "read results",
        f"format {VERSION} of result files, which offaxis {version('offaxis')} reads",
        f"format {found}, written by {writer}",
        f"read it with {said[0] if said else 'that version'} or a newer one, or measure again into another"
        " file",
    )
