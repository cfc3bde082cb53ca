"""Where results go, looked at before the work: no result is lost to a wrong name, no input overwritten."""

import os
from collections.abc import Iterable
from pathlib import Path

from dic.errors import OutputError


def require_places(inputs: Iterable[Path | None], outputs: Iterable[Path | None]) -> None:
    """Refuse output files that cannot be made, and those that would replace an input or one another.

    Parameters
    ----------
    inputs, outputs : iterable of path or None
        None stands for an option that was not given.

    Raises
    ------
    OutputError
        Naming the first output that cannot be.
    """
    taken = {path.resolve(): "one that is read" for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        place = path.resolve()
        got = taken.get(place) or _obstacle(place)
        if got is not None:
            raise OutputError(
                str(path),
                "write results",
                "a file of its own in a folder that can be written to",
                got,
                "name another place",
            )
        taken[place] = "one that holds other results"


def _obstacle(place: Path) -> str | None:
    if place.is_dir():
        return "a folder"
    if not place.parent.is_dir():
        return "no such folder"
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        return "one that is protected"
    return None
