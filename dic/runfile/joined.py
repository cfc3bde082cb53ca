"""Read a run, together with the earlier run that it continues, as a single run."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import RunFileError
from dic.files.digest import file_sha256
from dic.files.reading import opened
from dic.runfile.reader import RunFile, RunStep

_digests: dict[tuple[int, ...], str] = {}
"""Digests of earlier runs, by the identity of the file; a figure opens the same run for every step."""


def _digest(path: Path) -> str:
    with opened(path) as content:
        identity = content.identity
    if identity not in _digests:
        _digests[identity] = file_sha256(path)
    return _digests[identity]


def open_run(path: str | Path) -> RunFile:
    """Open a run file, together with the earlier run that it continues, if there is one.

    Raises `RunFileError` if a file cannot be read, or if the file of the earlier run is missing or was
    changed.
    """
    run = RunFile(path)
    if run.continues is None:
        return run
    run.close()
    return JoinedRun(path)


def exposures_us(run: RunFile, camera: str) -> NDArray[Any]:
    """Return the exposure times of a camera's frames in µs, together with those of the earlier run."""
    own: NDArray[Any] = run.columns(f"instrument/{camera}")["exposure_us"]
    return np.concatenate([exposures_us(run.earlier, camera), own]) if isinstance(run, JoinedRun) else own


class JoinedRun(RunFile):
    """A run that continues an earlier run, whose file is in the same folder.

    The steps are those of the earlier run, followed by those of the run itself.

    Attributes
    ----------
    earlier : RunFile
        The earlier run, which may itself continue another run.
    own_steps : list of RunStep
        The steps of this file alone.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self.own_steps = self.steps
        try:
            self.earlier = self._open_earlier()
        except BaseException:
            self.close()
            raise
        self.steps = [*self.earlier.steps, *self.own_steps]
        self._places_of_own = self._places
        self._places = {id(step): place for place, step in enumerate(self.steps)}

    def close(self) -> None:
        """Close both files."""
        super().close()
        if hasattr(self, "earlier"):
            self.earlier.close()

    def rows(self, camera: str, step: RunStep) -> range:
        """Return the row numbers of the frames that a camera took at a step, in the file of that step."""
        if not self._is_own(step):
            return self.earlier.rows(camera, step)
        return self._rows[camera][self._places_of_own[id(step)]]

    def image(self, camera: str, step: RunStep, *, stored: bool = False) -> NDArray[Any]:
        """Return the mean of a camera's frames at a step; see `RunFile.image`."""
        if self._is_own(step):
            return super().image(camera, step, stored=stored)
        return self.earlier.image(camera, step, stored=stored)

    def digest(self, camera: str, step: RunStep) -> str:
        """Return a SHA-256 that identifies a camera's frames at a step."""
        return super().digest(camera, step) if self._is_own(step) else self.earlier.digest(camera, step)

    def _is_own(self, step: RunStep) -> bool:
        return id(step) in self._places_of_own

    def _open_earlier(self) -> RunFile:
        known: dict[str, Any] = self.continues or {}
        name = str(known.get("file", ""))
        # Accept only a name without folders, so that a run file cannot bring any file of the computer into a
        # report.
        if not name or name != Path(name).name:
            raise self._damaged(f"the earlier run {name!r}")
        place = self.path.parent / name
        if not place.is_file():
            raise self._not_the_earlier(place, "no such file")
        if _digest(place) != known.get("sha256"):
            raise self._not_the_earlier(place, "another file of that name, or a changed one")
        return open_run(place)

    def _not_the_earlier(self, place: Path, got: str) -> RunFileError:
        return RunFileError(
            str(self.path),
            "read the earlier run",
            f"the run file {place} with the digest in this file",
            got,
            "copy the earlier run file into the same folder, unchanged",
        )
