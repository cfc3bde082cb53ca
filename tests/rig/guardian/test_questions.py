"""The run asks its guardian regularly whether it is alive, and not all the time."""

import subprocess
import sys
import time

from rig.guardian.guardian import PING_S, Guardian

ANSWERS = """
import os
count = 0
while os.read(0, 1) == b"p":
    count += 1
    os.write(1, b"alive null\\n")
os.write(2, b"%d" % count)
"""


def test_a_guardian_that_answers_at_once_is_asked_once_in_each_period():
    command = [sys.executable, "-c", ANSWERS]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, bufsize=0, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        guardian, troubles = Guardian(process, {}, 5.0), []
        begin_s = time.monotonic()
        with guardian.watched(troubles.append):
            time.sleep(6.0 * PING_S)
            guardian.close()
        lasted_s = time.monotonic() - begin_s
        assert troubles == []
        assert 1 <= int(process.stderr.read()) <= lasted_s / PING_S + 2
