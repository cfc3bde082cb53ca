"""A program can end although a thread hangs in a driver."""

import os
import subprocess
import sys
import warnings

import pytest

from drivers.errors import DeviceFault
from rig.threads import Bounded, drivers_exit_by_exception

HANGING_READ = """
import sys
from rig.threads import DeviceThread, leave

class Reader(DeviceThread):
    def run(self):
        sys.stdin.readline()  # holds the lock that Python takes at its own end

Reader("operator").start()
print("printed before the end")
leave(3)
"""


def ended(script: str) -> tuple[int, str, str]:
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.wait(60.0) is not None
        return process.returncode, process.stdout.read(), process.stderr.read()


def test_program_with_a_hanging_thread_ends_with_its_status_and_all_that_was_printed():
    assert ended(HANGING_READ) == (3, "printed before the end\n", "")


def test_thread_that_hung_before_the_command_or_is_just_ending_does_not_matter():
    script = """
import threading
from rig.threads import DeviceThread, device_threads, leave

class Waiter(DeviceThread):
    def __init__(self, wait_s):
        super().__init__("waiter")
        self.wait_s = wait_s
    def run(self):
        threading.Event().wait(self.wait_s)

Waiter(1000.0).start()
before = device_threads()
Waiter(0.05).start()
leave(3, before)
print("usual")
"""
    assert ended(script) == (0, "usual\n", "")


@pytest.mark.parametrize("status", [0, 2])
def test_program_without_a_hanging_thread_goes_on_to_its_usual_end(status):
    script = f"from rig.threads import leave\nleave(7)\nprint('usual')\nraise SystemExit({status})"
    assert ended(script) == (status, "usual\n", "")


@pytest.mark.parametrize("end", [lambda: os._exit(0), lambda: os.abort()])
def test_driver_that_would_end_the_process_is_told_instead(end):
    with drivers_exit_by_exception(), pytest.raises(DeviceFault, match="a driver that ends the program"):
        Bounded("stage", "read", end).result(60.0, "")


def test_process_that_a_driver_forks_may_end_itself():
    def fork():
        if not (child := os.fork()):
            os._exit(7)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    with drivers_exit_by_exception(), warnings.catch_warnings(action="ignore"):
        assert Bounded("stage", "read", fork).result(60.0, "") == 7
