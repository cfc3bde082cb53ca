"""Worker processes on this computer."""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from queue import Empty, SimpleQueue
from tempfile import TemporaryFile
from threading import Lock, Thread
from typing import Any, BinaryIO

from dic.errors import WorkerError
from dic.image.threads import processors
from dic.workers.pipes import Message, receive, send, unpacked, widen
from dic.workers.workers import Given, Result, Workers

_ATTEMPTS = 3
"""Number of attempts at a task. If the worker process ends at each attempt, the task is given up."""


_GONE_S = 5.0
"""Longest wait, in seconds, for the end of a process that has closed its pipe."""

_SHOWN_BYTES, _SHOWN_CHARACTERS = 4096, 300
"""Length of the end of a process's standard error that is read, and of its last line that is shown."""


# No ProcessPoolExecutor: one killed process breaks it, and a killed program leaves its processes behind.
class LocalWorkers(Workers):
    """Worker processes on this computer, each of which runs one function at a time.

    If a process is killed, a new process takes its place and runs the same function again.

    Parameters
    ----------
    count : int
        Number of processes.
    on_lost : callable, optional
        Function that is called with a sentence if a process was killed. It is called in another thread.
    begin : callable, optional
        Function that each process runs as soon as it is there, for example to load what the first function
        needs while this program prepares it. It must be picklable. Its result, or its error, is not used.
    """

    def __init__(
        self,
        count: int,
        on_lost: Callable[[str], None] = lambda _: None,
        begin: Callable[[], object] | None = None,
    ) -> None:
        if count < 1:
            raise WorkerError(
                "settings", "workers", "a number of processes, at least 1", str(count), "give --workers 2"
            )
        self.count, self._on_lost, self._threads_each = count, on_lost, max(1, processors() // count)
        self._tasks: SimpleQueue[tuple[Future[Any], Message] | None] = SimpleQueue()
        self._begin = None if begin is None else [pickle.dumps((begin, (), {}), protocol=5)]
        self._lock, self._ended = Lock(), False
        self._processes: dict[int, _Process] = {}
        self._threads = [Thread(target=self._serve, args=(k,), daemon=True) for k in range(1, count + 1)]
        for thread in self._threads:
            thread.start()

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Run a function in one of the processes; it and its arguments must be picklable."""
        future: Future[Result] = Future()
        # Copy the arrays now, because the caller may change them before the function runs.
        self._tasks.put((future, [pickle.dumps((fn, args, kwargs), protocol=5)]))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes; if `wait` is True, first run the functions that were submitted before."""
        if cancel_futures:
            # Do not wait for a task, because the serving threads take tasks at the same time.
            with suppress(Empty):
                while True:
                    task = self._tasks.get_nowait()
                    if task is not None:
                        task[0].cancel()
        for _ in self._threads:
            self._tasks.put(None)
        if not wait:
            self._kill()
        for thread in self._threads:
            thread.join()

    def _kill(self) -> None:
        with self._lock:
            self._ended = True
            for process in self._processes.values():
                process.stop()

    def _serve(self, number: int) -> None:
        """Give tasks to the process with the given number, one after the other."""
        if self._begin is not None:
            with suppress(WorkerError):
                # Whatever is wrong with the process is said when it has its first task.
                self._answer(number, self._begin)
        while (task := self._tasks.get()) is not None:
            future, content = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                result, error = unpacked(self._answer(number, content))
            except Exception as failure:
                result, error = None, failure
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)
        with self._lock:
            process = self._processes.pop(number, None)
        if process is not None:
            process.stop()
            process.ended()

    def _answer(self, number: int, task: Message) -> Message:
        ending = ""
        for attempt in range(_ATTEMPTS):
            process = self._process(number)
            try:
                return process.ask(task)
            except (EOFError, OSError):
                ending = process.ended()
            with self._lock:
                self._processes.pop(number)
                if self._ended:
                    break
            if attempt + 1 < _ATTEMPTS:
                self._on_lost(f"worker {number} of {len(self._threads)} {ending}; its image is done again")
        raise WorkerError(
            f"worker {number}",
            "correlate",
            "a process that runs until its image is done",
            f"{_ATTEMPTS} processes, the last of which {ending}",
            _MEMORY if ending.startswith(_KILLED) else _MEND,
        )

    def _process(self, number: int) -> "_Process":
        with self._lock:
            if self._ended:
                raise WorkerError("workers", "correlate", "open workers", "ended ones", "start new workers")
            if number not in self._processes:
                self._processes[number] = _Process(self._threads_each)
            return self._processes[number]


class _Process:
    """One worker process, which uses the given number of threads."""

    def __init__(self, threads: int) -> None:
        # Let the process import this package from the same folders as this program.
        found = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(threads))
        command = [sys.executable, "-P", "-m", "dic.workers.process", str(threads)]
        try:
            with ExitStack() as started:
                # A file takes any amount of text; a process that writes to a pipe would wait for a reader.
                self._errors = started.enter_context(TemporaryFile())
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=self._errors,
                    env=os.environ | found | limits,
                    # Protect the worker from Ctrl-C: this program ends after the current image, and then ends
                    # its workers.
                    start_new_session=True,
                )
                widen(self._process.stdout)  # type: ignore[arg-type]
                started.pop_all()
        except OSError as error:
            raise WorkerError(
                "--workers",
                "start a process",
                "a further Python process",
                error.strerror or str(error),
                _MEND,
            ) from error

    def ask(self, task: Message) -> Message:
        """Let the process run a task, and return its answer.

        Raises `EOFError` or `OSError` if the process has ended.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        send(self._process.stdin, task)  # type: ignore[arg-type]
        return receive(self._process.stdout)  # type: ignore[arg-type]

    def stop(self) -> None:
        """End the process at once. The thread that waits for its answer then gets an error."""
        self._process.kill()

    def ended(self) -> str:
        """Wait until the process is gone, and return words that say how it ended."""
        try:
            # The pipe of a process that ends is closed shortly before the process is gone.
            status = self._process.wait(_GONE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            status = self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        with self._errors:
            last = _last_line(self._errors)
        if status >= 0:
            return f"ended with status {status}" + (f" ({last})" if last else "")
        name = signal.Signals(-status).name
        return f"{_KILLED}; memory may be short)" if name == "SIGKILL" else f"crashed ({name})"


_KILLED = "was killed (SIGKILL"
_MEMORY = "give fewer --workers, because each of them needs memory, and the same command goes on"
_MEND = "mend this, or leave out --workers, and the same command goes on"


def _last_line(file: BinaryIO) -> str:
    """Return the last line of a file, which says why a Python program ended; "" for an empty file."""
    file.seek(max(0, file.seek(0, os.SEEK_END) - _SHOWN_BYTES))
    lines = file.read().decode(errors="replace").split("\n")
    return next((" ".join(line.split())[:_SHOWN_CHARACTERS] for line in reversed(lines) if line.strip()), "")
