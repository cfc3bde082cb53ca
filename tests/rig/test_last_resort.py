"""The system ends a program that does not end by itself, also if Python cannot run any more."""

import signal
import subprocess
import sys
import textwrap

import pytest

from tests.places import ROOT

PROGRAM = """
import ctypes, os, signal, sys, threading
import rig.threads
from rig.engine.signals import aborting_on_signals
rig.threads.LAST_RESORT_S = 0.3
class Stuck:
    def abort(self, reason):
        print(reason, flush=True)
"""
STUCK = {
    "after a signal": """
        with rig.threads.last_resort(), aborting_on_signals(Stuck()):
            signal.raise_signal(signal.SIGTERM)
            threading.Event().wait()
    """,
    "in a driver that never lets Python run": """
        with rig.threads.last_resort():
            rig.threads.still_running()
            ctypes.PyDLL(None).pause()
    """,
    "in output that nobody accepts, after a signal": """
        rig.threads.LAST_RESORT_S, rig.threads.OUTPUT_S = 1000.0, 0.3
        with rig.threads.last_resort():
            rig.threads.must_end()
            with rig.threads.dying_of_signals():
                os.write(os.pipe()[1], bytes(1 << 20))
    """,
}


@pytest.mark.parametrize("where", STUCK)
def test_program_that_is_stuck_is_ended_by_the_system(where):
    program = PROGRAM + textwrap.dedent(STUCK[where])
    ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=120, capture_output=True)
    assert ended.returncode == -signal.SIGALRM, ended.stderr


def test_program_that_uses_the_package_or_has_ended_is_left_alone():
    program = """
        with aborting_on_signals(Stuck()):
            signal.raise_signal(signal.SIGTERM)
            rig.threads.still_running()
            assert not signal.getitimer(signal.ITIMER_REAL)[0]
        with rig.threads.last_resort():
            rig.threads.still_running()
            assert signal.getitimer(signal.ITIMER_REAL)[0]
        assert not signal.getitimer(signal.ITIMER_REAL)[0]
    """
    command = [sys.executable, "-c", PROGRAM + textwrap.dedent(program)]
    assert subprocess.run(command, cwd=ROOT, timeout=120).returncode == 0
