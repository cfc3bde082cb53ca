"""Room for a new run file where a run that has recorded nothing left its file."""

from pathlib import Path

from dic.errors import RunFileError
from dic.runfile.reader import RunFile
from rig.recorder.recorder import run_file_exists

_ASIDE_MAX = 1000


def make_room(path: Path) -> Path | None:
    """Rename the file of an unfinished run without any step or image. Return its new path.

    A camera that was not plugged in ends a run before its first step. The file still has the reason, so it is
    kept under another name, and the next run gets the name that the user wants.

    Return None if there is no file at `path`. Raise `RecordingError` if the file has a step or an image, is
    still recorded, or is no run file.
    """
    if not path.exists():
        return None
    aside = next(
        other
        for number in range(1, _ASIDE_MAX)
        if not (other := path.with_name(f"{path.stem}.nothing-{number}{path.suffix}")).exists()
    )
    if not _has_nothing(path):
        raise run_file_exists(path)
    return path.rename(aside)


def _has_nothing(path: Path) -> bool:
    try:
        with RunFile(path) as run:
            ended = run.info.status in ("failed", "aborted")
            return ended and not run.steps and not any(run.rows_on_file(name) for name in run.cameras)
    except RunFileError:
        return False
