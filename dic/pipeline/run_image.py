"""An image of a run file; another process gets only its place and reads it from the same file."""

import platform
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from dic.errors import RunFileError, WorkerError
from dic.files.reading import opened
from dic.pipeline.series_image import UNREADABLE
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile, RunStep


@dataclass(frozen=True)
class RunImage:
    """The image of a camera at a step of a run, which is read when the object is called."""

    run: RunFile
    camera: str
    step: RunStep

    def __call__(self) -> NDArray[Any]:
        """Return the mean of the camera's frames; a single frame has the integer type of the file."""
        return self.run.image(self.camera, self.step, stored=True)

    def digest(self) -> str:
        """Return the digest of the frames; `UNREADABLE` if they cannot be read."""
        try:
            return self.run.digest(self.camera, self.step)
        except RunFileError:
            # The later reading of the image will raise an error with the reason.
            return UNREADABLE

    def __reduce__(self) -> "tuple[Callable[..., RunImage], tuple[str, str, int]]":
        # The other process may work in another folder.
        return _received, (str(self.run.path.absolute()), self.camera, self.run.place(self.step))


def _received(path: str, camera: str, index: int) -> RunImage:
    run = _opened(path)
    if index >= len(run.steps):
        raise WorkerError(
            f"{path}, read on {platform.node()}",
            "read run",
            "the run that the command reads",
            f"another one, with {len(run.steps)} steps",
            "give all workers the same files under the same paths",
        )
    return RunImage(run, camera, run.steps[index])


_last: tuple[tuple[int, ...], RunFile] | None = None
"""The identity of the run file that was opened last, and the open file."""


def _opened(path: str) -> RunFile:
    """Return a run that is open already; open it if it is another file than the last one."""
    global _last
    try:
        with opened(path) as content:
            identity = content.identity
    except OSError:
        # The reader of the run raises an error with the reason.
        return open_run(path)
    if _last is None or _last[0] != identity:
        # Do not close the last run here, because a received reference may still read its image. HDF5 closes
        # the file when no image of the run is left.
        _last = identity, open_run(path)
    return _last[1]
