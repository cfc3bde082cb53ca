"""Locks of machines: while a run and its guardian have the lock of a machine, no other program can use it."""

import contextlib
import fcntl
import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rig.errors import RigError
from rig.guardian.machines import machines, shared_line
from rig.rigfile import DeviceEntry, RigFile

SYSTEM_FOLDER = Path("/run/lock")
SHOWN_MAX = 120


class MachineInUse(RigError):
    """Another program holds the lock of a machine. `got` says which program.

    `pid` is the number of the program's process, or 0 if it is unknown.
    """

    pid = 0


@contextmanager
def machines_locked(rig_file: RigFile, folder: Path | None = None) -> Iterator[list[int]]:
    """Hold the lock of each machine of a rig, and yield the descriptors of the locks.

    A process that inherits the descriptors shares the locks. The locks are released when the last of these
    processes ends.

    `folder` is the folder of the lock files. The default is ``/run/lock``, or else the folder of temporary
    files. Raise `MachineInUse` if another program holds the lock of a machine, and `RigError` if a lock file
    cannot be opened.
    """
    with ExitStack() as held:
        locks = []
        for entry in machines(rig_file):
            if line := shared_line(entry):
                descriptor = _open(lock_path(line, folder))
                held.callback(os.close, descriptor)
                _take(descriptor, entry, line)
                locks.append(descriptor)
        yield locks


def lock_path(line: str, folder: Path | None = None) -> Path:
    """Return the path of the lock file for a line."""
    readable = re.sub(r"[^A-Za-z0-9.]+", "-", line).strip("-")[-60:]
    digest = hashlib.sha256(line.encode()).hexdigest()[:8]
    return (folder or _folder()) / f"offaxis-{readable}-{digest}.lock"


def note_holder(descriptor: int, doing: str = "") -> None:
    """Write this process's number, and `doing` or its command, into a lock file, for messages of others."""
    text = f"{os.getpid()}\n{doing or ' '.join(sys.argv)}\n".encode(errors="replace")
    with contextlib.suppress(OSError):
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, text, 0)


def _folder() -> Path:
    # The folder must not depend on the user, because all users of this computer must find the same file.
    return SYSTEM_FOLDER if os.access(SYSTEM_FOLDER, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())


def _open(path: Path) -> int:
    # First open without O_CREAT: Linux refuses it for another user's file in a folder that everybody may
    # write.
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        try:
            return os.open(path, flags)
        except FileNotFoundError:
            descriptor = os.open(path, flags | os.O_CREAT, 0o666)
            with contextlib.suppress(OSError):
                # make the file writable for all users, whatever the umask is, so that each of them can lock
                # it
                os.fchmod(descriptor, 0o666)
            return descriptor
    except OSError as error:
        raise RigError(
            str(path),
            "a lock file that can be opened",
            error.strerror or str(error),
            "remove the file, or give all users of this computer the right to write it",
        ) from error


def _take(descriptor: int, entry: DeviceEntry, line: str) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        pid, _, command = os.pread(descriptor, 4096, 0).decode(errors="replace").partition("\n")
        holder = (
            f"pid {pid} ({command.strip()[:SHOWN_MAX]})" if pid else "a program that does not say who it is"
        )
        in_use = MachineInUse(
            f"{entry.name} ({line})",
            "a machine that no other program commands",
            f"{holder}, which has opened it",
            "wait until that program has ended, or end it",
        )
        if pid.isdecimal() and _has_open(int(pid), descriptor):
            in_use.pid = int(pid)
        raise in_use from error
    note_holder(descriptor)


def _has_open(pid: int, descriptor: int) -> bool:
    """Return whether another process has the file open, into which everybody can write a number."""
    if pid == os.getpid():
        return False
    try:
        return any(
            os.path.samestat(os.fstat(descriptor), each.stat()) for each in Path(f"/proc/{pid}/fd").iterdir()
        )
    except OSError:
        return False
