"""A guardian that goes on trying to stop a machine is left alone, and one that hangs is killed."""

import os
import subprocess
import sys
import threading

import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceTimeout
from drivers.registry import GUARD_STOP_MAX_S
from rig.guardian.guardian import Guardian
from rig.guardian.stop import Stop

ANSWERING = """
import os, sys
while os.read(0, 1):
    os.write(1, b'alive {"stage": %s}\\n')
"""


class Stage:
    """A guard whose stage does not confirm its first stops."""

    relay = ""

    def __init__(self, lost: int) -> None:
        self.lost, self.stood = lost, threading.Event()

    def check(self) -> None:
        pass

    def stop(self) -> None:
        self.lost -= 1
        if self.lost >= 0:
            raise DeviceTimeout("stage", "stop", "standstill", "silence", "press the emergency stop")
        self.stood.set()

    def close(self) -> None:
        pass


def watched(age: str, waits_s: float) -> tuple[list[str], int | None]:
    """Watch a program that says the age of its attempt; return the trouble and the program's status."""
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", ANSWERING % age]
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, bufsize=0)
    trouble, told = [], threading.Event()
    try:
        with Guardian(process, {}, 30.0).watched(lambda said: (trouble.append(said), told.set())):
            told.wait(waits_s)
        return list(trouble), process.wait(30.0) if trouble else process.poll()
    finally:
        process.kill()
        process.communicate()


def wait_for(stop: Stop) -> None:
    while not stop.ended:
        os.sched_yield()


def test_guardian_whose_attempt_hangs_is_killed_so_that_the_run_can_use_its_line():
    trouble, status = watched(f"{GUARD_STOP_MAX_S + 1}", 30.0)
    assert trouble == ["the guardian's stop of stage hangs: the run is not guarded any more"]
    assert status == -9


def test_guardian_that_begins_a_new_attempt_in_time_is_left_alone():
    assert watched(f"{GUARD_STOP_MAX_S - 1}", 0.5) == ([], None)


@pytest.mark.parametrize("lost", [0, 3])
def test_stop_is_repeated_until_the_machine_confirms_it(lost):
    stage = Stage(lost)
    stop = Stop({"stage": stage}, clock=VirtualClock())
    assert stage.stood.wait(30.0)
    wait_for(stop)
    assert stop.confirmed
    assert stop.ages_s() == {}
    assert stop.describe().startswith("stage stopped, confirmed after")


def test_stop_ends_with_what_the_machine_did_not_do_when_its_time_is_over():
    stop = Stop({"stage": Stage(10**9)}, clock=VirtualClock())
    wait_for(stop)
    assert not stop.confirmed
    assert "STOP NOT CONFIRMED, use the emergency stop (stage: stage: stop: expected" in stop.describe()
