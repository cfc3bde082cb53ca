"""What workers on this computer do and `concurrent.futures.ProcessPoolExecutor` does not.

If a new Python lets one of these tests fail with the standard executor, the executor may be enough.
"""

import multiprocessing
import os
import select
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import pytest

from dic.errors import WorkerError
from dic.workers.local import LocalWorkers
from tests.dic.workers.test_local import mark_and_die

LOCAL = "from dic import LocalWorkers\nworkers = LocalWorkers(1)\n"
STANDARD = (
    "import multiprocessing\nfrom concurrent.futures import ProcessPoolExecutor\n"
    "workers = ProcessPoolExecutor(1, multiprocessing.get_context('spawn'))\n"
)
GUARDED = "import os, signal, sys\nif __name__ == '__main__':\n    "
LONG_MS, SHORT_MS = 60_000, 1_000


def standard(count: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(count, multiprocessing.get_context("spawn"))


def ran(tmp_path, text: str) -> "subprocess.CompletedProcess[str]":
    """Run a script as a user does, and wait for its end."""
    (tmp_path / "script.py").write_text(text)
    return subprocess.run(
        [sys.executable, tmp_path / "script.py"], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(("start", "works"), [(LOCAL, True), (STANDARD, False)], ids=["local", "standard"])
def test_script_needs_no_guard_around_its_main_part(tmp_path, start, works):
    ended = ran(tmp_path, start + "print(workers.submit(abs, -3).result())\nworkers.shutdown()\n")
    assert (ended.stdout == "3\n") is works
    assert ("An attempt has been made to start a new process" in ended.stderr) is not works


@pytest.mark.parametrize(("start", "ends"), [(LOCAL, True), (STANDARD, False)], ids=["local", "standard"])
def test_process_of_a_killed_program_ends(tmp_path, start, ends):
    body = (
        start
        + "print(workers.submit(os.getpid).result(), flush=True)\nos.kill(os.getpid(), signal.SIGKILL)\n"
    )
    (tmp_path / "script.py").write_text(GUARDED + body.replace("\n", "\n    "))
    command = [sys.executable, tmp_path / "script.py"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as program:
        assert program.stdout is not None
        number = int(program.stdout.readline())
        assert program.wait() == -signal.SIGKILL
    assert gone(number, LONG_MS if ends else SHORT_MS) is ends
    if not ends:
        os.kill(number, signal.SIGKILL)


def gone(number: int, most_ms: int) -> bool:
    """Wait until a process has ended, but not longer than the given time."""
    try:
        process = os.pidfd_open(number)
    except ProcessLookupError:
        return True
    try:
        waiting = select.poll()
        waiting.register(process, select.POLLIN)
        return bool(waiting.poll(most_ms))
    finally:
        os.close(process)


def test_killed_process_is_replaced_and_the_reason_is_told(tmp_path):
    with LocalWorkers(1) as workers:
        killed, after = workers.submit(mark_and_die, str(tmp_path), 99), workers.submit(abs, -3)
        assert after.result() == 3
        assert isinstance(killed.exception(), WorkerError)
        assert "SIGKILL" in str(killed.exception())
    with standard(1) as pool:
        killed, after = pool.submit(mark_and_die, str(tmp_path), 99), pool.submit(abs, -3)
        for task in (killed, after):
            assert isinstance(task.exception(), BrokenProcessPool)
            assert "SIGKILL" not in str(task.exception())
        with pytest.raises(BrokenProcessPool):
            pool.submit(os.getpid)


def test_running_task_ends_with_the_workers():
    with LocalWorkers(1) as workers:
        number, busy = workers.submit(os.getpid).result(), workers.submit(signal.pause)
        while not busy.running():
            pass
    assert gone(number, LONG_MS)
    assert isinstance(busy.exception(0), WorkerError)
    pool = standard(1)
    number, busy = pool.submit(os.getpid).result(), pool.submit(signal.pause)
    while not busy.running():
        pass
    pool.shutdown(wait=False, cancel_futures=True)
    assert not gone(number, SHORT_MS)
    os.kill(number, signal.SIGKILL)
    assert isinstance(busy.exception(), BrokenProcessPool)
