"""Whether a run file is still where its path says. It can be deleted, moved or unmounted while it is written.

The recorder's open descriptor goes on working then. So nothing else would notice that the run is recorded to
a file that nobody finds, or that vanishes with the program.
"""

import os
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir

_COPIES_MAX = 100


class Misplaced(OSError):
    """The run file is not at its path any more. The message says where its data are."""


def require_in_place(descriptor: int, path: Path) -> None:
    """Compare an open file with the file at its path.

    Raises
    ------
    Misplaced
        If there is no file at the path, or another one.
    """
    if _is(descriptor, path):
        return
    if not os.fstat(descriptor).st_nlink:
        raise Misplaced(f"a deleted file, whose data are copied to {rescue_path(path)} at the end of the run")
    with suppress(OSError):  # without /proc, nobody can tell the new place
        place = content(descriptor, path).readlink()
        if _is(descriptor, place):
            path = place
    if _is(descriptor, path):
        raise Misplaced(f"a file that was moved: the data are in {path}")
    folder = path.absolute().parent
    raise Misplaced(
        f"a file on a volume that is no longer mounted at {folder}: the data are there, in {path.name}"
    )


def _is(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except OSError:
        return False


def content(descriptor: int, path: Path) -> Path:
    """Return a path that opens the file of a descriptor, wherever it is; `path` if the system has none."""
    opened = Path(f"/proc/self/fd/{descriptor}")
    return opened if opened.exists() else path


def rescue_path(path: Path) -> Path:
    """Return the path to which the data of a deleted file are copied, beside it or where one may write."""
    folders = [path.absolute().parent, Path.cwd(), Path(gettempdir())]
    folder = next((folder for folder in folders if os.access(folder, os.W_OK | os.X_OK)), folders[-1])
    names = [f"{path.stem}.rescued{'' if k == 1 else k}{path.suffix}" for k in range(1, _COPIES_MAX)]
    return next((folder / name for name in names if not (folder / name).exists()), folder / names[-1])


def rescue(descriptor: int, path: Path) -> None:
    """Copy a deleted file to `rescue_path`. Do nothing if the file was not deleted.

    Raises
    ------
    OSError
        If the copy cannot be written.
    """
    status = os.fstat(descriptor)
    if status.st_nlink:
        return
    copy = os.open(rescue_path(path), os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o444)
    try:
        offset = 0
        while offset < status.st_size and (count := os.sendfile(copy, descriptor, offset, status.st_size)):
            offset += count
        os.fsync(copy)
    finally:
        os.close(copy)
