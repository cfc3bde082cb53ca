"""Starts the processes of the live measurement."""

import os
import subprocess
import sys
from collections.abc import Sequence
from tempfile import TemporaryFile
from typing import IO, Any

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
_SHOWN_BYTES, _SHOWN_CHARACTERS = 4096, 300


class Started:
    """A process of Python that was started, and the end of what it has written to standard error.

    Parameters
    ----------
    module : str
        The module that it runs. Its argument is the number of the process that starts it.
    inherited : sequence of int
        Further descriptors that it inherits.
    new_group : bool
        True if it leads a new session, which is also a new group of processes. Ctrl-C is not sent to it then.
    """

    def __init__(self, module: str, inherited: Sequence[int], *, new_group: bool) -> None:
        # Let the process import this package from the same folders as this program, and no other one.
        found = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        # A file takes any amount of text; a process that writes to a pipe would wait for a reader.
        self._errors: IO[bytes] = TemporaryFile()  # noqa: SIM115
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | found | _ONE_THREAD,
                pass_fds=tuple(inherited),
                start_new_session=new_group,
            )
        except OSError:
            self._errors.close()
            raise

    @property
    def to(self) -> int:
        """The end of the pipe to the process."""
        return _pipe(self.process.stdin).fileno()

    @property
    def back(self) -> int:
        """The end of the pipe from the process."""
        return _pipe(self.process.stdout).fileno()

    @property
    def ending(self) -> str:
        """How the process has ended, with the last line that it has written; empty while it runs."""
        status = self.process.poll()
        if status is None:
            return ""
        how = f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - _SHOWN_BYTES))
        lines = self._errors.read().decode(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f"{how}: {last[-_SHOWN_CHARACTERS:]}" if last and status >= 0 else how

    def close(self) -> None:
        """Release the pipes of a process that has ended."""
        _pipe(self.process.stdin).close()
        _pipe(self.process.stdout).close()
        self._errors.close()


def _pipe(pipe: IO[Any] | None) -> IO[Any]:
    assert pipe is not None
    return pipe
