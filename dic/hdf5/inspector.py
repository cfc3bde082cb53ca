"""The process that inspects HDF5 files, started at the first file and used for all further files."""

import atexit
import json
import os
import select
import subprocess
import sys
import threading
from pathlib import Path

_COMMAND = [sys.executable, "-P", "-m", "dic.hdf5.inspection"]

_lock = threading.Lock()
_process: subprocess.Popen[bytes] | None = None
_owner = 0
"""Number of the process that started the inspector. A copy of this process must not use the same pipes."""
_of_others: list["subprocess.Popen[bytes]"] = []
"""Inspectors of the process from which this process was copied.

This list keeps the `Popen` objects, because Python would poll the processes when it deletes these objects.
"""


def ask_inspector(path: Path, timeout_s: float) -> tuple[int, str]:
    """Let the inspecting process inspect a file.

    `timeout_s`: longest wait for the answer, in seconds of real time.

    Result: the exit status of the process that inspected the file, or the negative number of the signal that
    ended it; and the reason why the file is refused, which is empty if the file is good.

    Raises `TimeoutError` if no answer came in time. The inspecting process was then ended. Raises `OSError`
    if no process can be started.
    """
    if not hasattr(os, "fork"):
        return _ask_once(path, timeout_s)
    with _lock:
        for _ in range(2):
            line = _answer(_started(), json.dumps(str(path.absolute())).encode() + b"\n", timeout_s)
            if line:
                status, said = json.loads(line)
                return int(status), str(said)
            # The process has ended, because it was idle or was killed. Start a new process.
            _end()
    raise OSError("the process ended twice without an answer")


def _ask_once(path: Path, timeout_s: float) -> tuple[int, str]:
    """Start a process for this file alone, because Windows cannot copy a process that has loaded HDF5."""
    command = [*_COMMAND, str(path.absolute())]
    try:
        ended = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=timeout_s, env=environment(),
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise TimeoutError from error
    if ended.returncode:
        return ended.returncode, ""
    status, said = json.loads(ended.stdout)
    return int(status), str(said)


def environment() -> dict[str, str]:
    """Return the environment of a process that reads files of others."""
    # Prevent HDF5 from loading a plugin that the file asks for.
    return os.environ | {"HDF5_PLUGIN_PRELOAD": "::", "OPENBLAS_NUM_THREADS": "1"}


def _started() -> "subprocess.Popen[bytes]":
    global _process, _owner
    if _process is not None and _owner != os.getpid():
        _of_others.append(_process)
        _process = None
    if _process is None:
        _process = subprocess.Popen(
            _COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment(),
            bufsize=0,
            # Ctrl-C ends this program, which then ends the inspector.
            start_new_session=True,
        )
        _owner = os.getpid()
    return _process


def _answer(process: "subprocess.Popen[bytes]", request: bytes, timeout_s: float) -> bytes:
    """Return the line that answers a request, or nothing if the process has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(request)
    except BrokenPipeError:
        return b""
    if not select.select([process.stdout], [], [], timeout_s)[0]:
        _end()
        raise TimeoutError
    return process.stdout.readline()


@atexit.register
def _end() -> None:
    """End the inspecting process and everything that it has started."""
    global _process
    process, _process = _process, None
    if process is None or _owner != os.getpid():
        return
    os.killpg(process.pid, 9)
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    process.wait()
