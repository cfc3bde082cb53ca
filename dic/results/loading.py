"""Open and read result files, and refuse a damaged file in one sentence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from dic.errors import MeasurementError
from dic.hdf5.open import NotReadable, open_hdf5
from dic.hdf5.version import require_version
from dic.results.schema import VERSION
from dic.results.shapes import Contradiction

Result = TypeVar("Result")


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
    every value once, if another program may have written the file. Then a file that lacks a value is refused
    now, and not in the middle of a report.
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


def require_known(path: Path, file: Any) -> None:
    """Refuse an open result file of an unknown format, and name the program that wrote it."""
    origin = file.get("provenance")
    written_by = "" if origin is None else str(origin.attrs.get("versions", ""))
    found, otherwise = file.attrs["file_format_version"], ", or measure again into another file"
    require_version(path, "read results", "result", found, VERSION, written_by, otherwise)
