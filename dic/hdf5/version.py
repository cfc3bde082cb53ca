"""Refuse a file whose format this program does not know."""

import re
from importlib.metadata import version
from pathlib import Path

from dic.errors import RunFileError

_WRITER = re.compile(r"\boffaxis [\w.+!]+")


def require_version(
    path: Path, step: str, kind: str, found: object, known: int, written_by: str, otherwise: str = ""
) -> None:
    """Raise a `RunFileError` if a file has another format than the one that this program reads.

    `step`: what the caller does, such as "read run". `kind`: kind of the file, such as "run". `found`: the
    version of the file's format, as it is in the file. `known`: the version that this program reads.
    `written_by`: the versions of all programs that wrote the file, as the file states them; "" if it does
    not. `otherwise`: what else the user can do, as a part of a sentence. The error names the version of
    offaxis that wrote the file.
    """
    if found == known:
        return
    said = _WRITER.search(written_by)
    raise RunFileError(
        str(path),
        step,
        f"format {known} of {kind} files, which offaxis {version('offaxis')} reads",
        f"format {found}, written by {said[0] if said else 'an unknown version of offaxis'}",
        f"read it with {said[0] if said else 'that version'} or a newer one{otherwise}",
    )
