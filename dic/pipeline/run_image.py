"""An image of a run file; another process gets only its place and reads it from the same file."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from dic.errors import RunFileError
from dic.pipeline.series_image import UNREADABLE
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile, RunStep
from dic.typing import Grey


@dataclass(frozen=True)
class RunImage:
    """The image of a camera at a step of a run, which is read when the object is called.

    Attributes
    ----------
    run : RunFile
    camera : str
    step : RunStep
    """

    run: RunFile
    camera: str
    step: RunStep

    def __call__(self) -> Grey:
        """Return the mean of the camera's frames; see `RunFile.image`."""
        return self.run.image(self.camera, self.step)

    def digest(self) -> str:
        """Return the digest of the frames; `UNREADABLE` if they cannot be read."""
        try:
            return self.run.digest(self.camera, self.step)
        except RunFileError:
            # The later reading of the image will raise an error with the reason.
            return UNREADABLE

    def __reduce__(self) -> "tuple[Callable[..., RunImage], tuple[str, str, int]]":
        # The other process may work in another folder.
        return _received, (str(self.run.path.absolute()), self.camera, self.run.steps.index(self.step))


def _received(path: str, camera: str, index: int) -> RunImage:
    run = _opened(path)
    return RunImage(run, camera, run.steps[index])


@lru_cache(1)
def _opened(path: str) -> RunFile:
    return open_run(path)
