"""Checks of output paths before the work, so that no result is lost and no input overwritten."""

import os
from collections.abc import Iterable
from pathlib import Path

from dic.errors import OutputError


def require_places(inputs: Iterable[Path | None], outputs: Iterable[Path | None]) -> None:
    """Refuse output files that cannot be created, or would replace an input or one another.

    Parameters
    ----------
    inputs, outputs : iterable of path or None
        None stands for an option that was not given.

    Raises
    ------
    OutputError
        Names the first refused output.
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
