"""Frames in shared memory: whole ones only, the newest first, without waiting, in two processes."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from rig.live.frame_ring import SLOTS, FrameRing, RingShape
from rig.live.memory import SharedMemory
from tests.rig.live.rendered_rig import frame_of

SHAPE = RingShape((400, 500), "uint16")
READER = """
import sys, time
from rig.live.frame_ring import FrameRing, RingShape
ring = FrameRing(RingShape((400, 500), "uint16"), int(sys.argv[1]))
seen, whole, gone = 0, 0, 0
print("ready", flush=True)
while seen < int(sys.argv[2]):
    for arrival in ring.arrivals(seen):
        seen = arrival.number
        with ring.held(seen) as image:
            if image is None:
                gone += 1
                continue
            first = image.copy()
            time.sleep(0.002)
            assert (image == first).all() and (first == arrival.sequence).all(), "a torn frame"
            whole += 1
print(whole, gone)
"""


def filled(number):
    return frame_of(np.full(SHAPE.shape, number, np.uint16), number, 0.1 * number)


def test_no_reader_ever_sees_a_part_of_a_frame():
    """The writer is much faster than the reader and wraps around many times."""
    ring, count = FrameRing(SHAPE), 3000
    command = [sys.executable, "-c", READER, str(ring.memory.descriptor), str(count)]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    reader = subprocess.Popen(
        command, pass_fds=[ring.memory.descriptor], stdout=subprocess.PIPE, text=True, env=env
    )
    assert reader.stdout.readline() == "ready\n"
    for number in range(1, count + 1):
        ring.write(filled(number))
    answer, _ = reader.communicate(timeout=60)
    assert reader.returncode == 0, answer
    whole, gone = map(int, answer.split())
    assert whole > 5
    assert whole + gone <= count
    ring.close()


def test_the_newest_frames_stay_and_older_ones_are_replaced():
    ring = FrameRing(SHAPE)
    for number in range(1, SLOTS + 4):
        ring.write(filled(number))
    assert [each.number for each in ring.arrivals(0)] == list(range(4, SLOTS + 4))
    newest = ring.arrivals(SLOTS + 2)
    assert [(each.sequence, each.time_std_s) for each in newest] == [(SLOTS + 3, 1e-4)]
    assert newest[0].time_s == pytest.approx(0.1 * (SLOTS + 3))
    with ring.held(2) as image:
        assert image is None
    with ring.held(SLOTS + 3) as image:
        assert (image == SLOTS + 3).all()
    ring.close()
    ring.write(filled(99))
    assert ring.newest == SLOTS + 3


def test_a_frame_of_another_format_is_refused():
    ring = FrameRing(SHAPE)
    with pytest.raises(ValueError, match="500 x 400 px as uint16"):
        ring.write(frame_of(np.zeros((10, 10), np.uint16), 1, 0.0))
    ring.close()


def named_memory(pid):
    """Return the files in the folder of shared memory that a process has opened or mapped."""
    folder = Path("/proc") / str(pid)
    found = {line.rpartition(" ")[2] for line in (folder / "maps").read_text().splitlines()}
    for path in (folder / "fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            found.add(str(path.readlink()))
    return {path for path in found if path.startswith("/dev/shm/")}


def test_the_memory_has_no_name_that_could_stay_behind():
    before = named_memory(os.getpid())
    with SharedMemory(10) as memory:
        memory.buffer[:3] = b"abc"
        assert bytes(memory.buffer[:4]) == b"abc\0"
        assert named_memory(os.getpid()) <= before
