"""Worker processes on this computer: killed ones are replaced, and nothing that was given to them is lost."""

import os
import signal
import subprocess
from concurrent.futures import CancelledError
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import current_thread, main_thread

import pytest

from dic.errors import CorrelationError, WorkerError
from dic.workers.local import LocalWorkers


def mark_and_die(marks: str, times: int) -> int:
    """End this process by a signal, but only the first `times` times; then return the number of deaths."""
    deaths = len(list(Path(marks).iterdir()))
    if deaths < times:
        (Path(marks) / str(deaths)).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return deaths


def refuse() -> None:
    raise CorrelationError("settings", "subset", "an odd number", "20", "give 21")


def leave_mark(marks: str) -> None:
    (Path(marks) / str(os.getpid())).touch()
    refuse()


def test_each_process_begins_with_a_function_whose_error_does_not_matter(tmp_path):
    with LocalWorkers(2, begin=partial(leave_mark, str(tmp_path))) as workers:
        used = {workers.submit(os.getpid).result() for _ in range(4)}
        workers.shutdown()
    begun = {int(mark.name) for mark in tmp_path.iterdir()}
    assert len(begun) == 2
    assert used <= begun


def test_function_of_a_killed_process_runs_again_and_the_user_is_told(tmp_path):
    told = []
    with LocalWorkers(1, told.append) as workers:
        killed, after = workers.submit(mark_and_die, str(tmp_path), 1), workers.submit(os.getpid)
        assert killed.result() == 1
        assert after.result() != os.getpid()
        with pytest.raises(CorrelationError, match="give 21"):
            workers.submit(refuse).result()
    (sentence,) = told
    assert "worker 1 of 1 was killed (SIGKILL" in sentence
    assert "its image is done again" in sentence


def test_function_that_ends_every_process_is_given_up_in_one_sentence(tmp_path):
    with LocalWorkers(1) as workers, pytest.raises(WorkerError, match="give fewer --workers") as refusal:
        workers.submit(mark_and_die, str(tmp_path), 9).result()
    assert len(list(tmp_path.iterdir())) == 3
    assert "\n" not in str(refusal.value)


def test_nothing_waits_for_workers_that_are_closed(tmp_path):
    with LocalWorkers(1) as workers:
        assert workers.submit(os.getpid).result() > 0
        busy = workers.submit(signal.pause)
        waiting = workers.submit(os.getpid)
        while not busy.running():
            pass
    assert isinstance(busy.exception(), WorkerError)
    with pytest.raises(CancelledError):
        waiting.result()
    with pytest.raises(WorkerError, match="at least 1, got 0"):
        LocalWorkers(0)


def test_reason_why_no_process_starts_is_told(tmp_path, monkeypatch):
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\necho 'Traceback' >&2\necho 'ImportError: no NumPy' >&2\nexit 3\n")
    program.chmod(0o700)
    monkeypatch.setattr("sys.executable", str(program))
    with LocalWorkers(1) as workers, pytest.raises(WorkerError) as refusal:
        workers.submit(os.getpid).result()
    assert "the last of which ended with status 3 (ImportError: no NumPy); mend this" in str(refusal.value)


def test_process_that_the_system_refuses_is_one_sentence(monkeypatch):
    def refuse_process(*_: object, **__: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(subprocess, "Popen", refuse_process)
    with LocalWorkers(1) as workers, pytest.raises(WorkerError) as refusal:
        workers.submit(os.getpid).result()
    assert "start a process: expected a further Python process, got Resource temp" in str(refusal.value)


class Emptied(SimpleQueue):
    """A queue that another thread empties after the main thread has found it not empty."""

    def empty(self) -> bool:
        return False

    def get(self, block: bool = True, timeout: float | None = None) -> object:
        assert current_thread() is not main_thread(), "waits for a task for ever"
        return super().get(block, timeout)


def test_end_does_not_wait_for_a_task_that_a_thread_has_taken(monkeypatch):
    monkeypatch.setattr("dic.workers.local.SimpleQueue", Emptied)
    workers = LocalWorkers(1)
    workers.shutdown(wait=False, cancel_futures=True)
    assert not any(thread.is_alive() for thread in workers._threads)
