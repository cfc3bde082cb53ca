"""Whether a run file is still where its path says, and still ours. It can be deleted, moved, unmounted or
overwritten while it is written.

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


class Overwritten(OSError):
    """Another program has emptied the run file, or written to it."""


def require_untouched(descriptor: int, beginning: bytes, least_bytes: int) -> None:
    """Compare an open file with what was written to it: its first bytes, and its size.

    Raise `Overwritten` if the file begins with other bytes, or is smaller than it was.
    """
    size = os.fstat(descriptor).st_size
    if size < least_bytes or os.pread(descriptor, len(beginning), 0) != beginning:
        raise Overwritten(
            f"a file of {size} bytes that another program has emptied or overwritten, so that the images and "
            "readings in it are lost"
        )


def require_in_place(descriptor: int, path: Path) -> None:
    """Compare an open file with the file at its path.

    Raise `Misplaced` if there is no file at the path, or another one.
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
    if _has_other_name(descriptor, path):
        number = os.fstat(descriptor).st_ino
        raise Misplaced(
            f"a file whose name was deleted, but which has another one: the data are in the file that "
            f"find -inum {number} shows on this volume"
        )
    folder = path.absolute().parent
    raise Misplaced(
        f"a file on a volume that is no longer mounted at {folder}: the data are there, in {path.name}"
    )


def _has_other_name(descriptor: int, path: Path) -> bool:
    """Return whether the name was deleted under which the file was opened, while another name is left."""
    try:
        opened = content(descriptor, path).readlink()
    except OSError:
        return False
    return opened.name.endswith(" (deleted)") and os.fstat(descriptor).st_nlink > 0


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

    Raise `OSError` if the copy cannot be written.
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
