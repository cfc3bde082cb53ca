"""Refuse a file whose format this program does not know."""

import re
from importlib.metadata import version
from pathlib import Path

from dic.errors import RunFileError

_WRITER = re.compile(r"\boffaxis [\w.+!]+")


def require_version(path: Path, kind: str, found: object, known: int, written_by: str) -> None:
    """Raise an error if a file has another format than the one that this program reads.

    Parameters
    ----------
    path : Path
    kind : str
        "run" or "result".
    found, known : int
        The version of the file's format, and the version that this program reads.
    written_by : str
        The versions of all programs that wrote the file, as the file states them; "" if it does not.

    Raises
    ------
    RunFileError
        Names the version of offaxis that wrote the file.
    """
    if found == known:
        return
    said = _WRITER.search(written_by)
    step, else_ = (
        ("read results", ", or measure again into another file") if kind == "result" else ("read run", "")
    )
    raise RunFileError(
        str(path),
        step,
        f"format {known} of {kind} files, which offaxis {version('offaxis')} reads",
        f"format {found}, written by {said[0] if said else 'an unknown version of offaxis'}",
        f"read it with {said[0] if said else 'that version'} or a newer one{else_}",
    )
