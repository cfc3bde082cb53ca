"""Where the C library takes memory from, and when it keeps freed memory for the next image."""

import subprocess
import sys

import pytest

# Each round writes to a fresh array of 1 MB, too small for huge pages, that is to 256 pages of 4 kB.
_COUNT = """
import resource
import numpy as np
from dic.image.memory import keep_freed_memory


def faults(rounds):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(rounds):
        np.ones(2**17)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


before = faults(20)
keep_freed_memory()
faults(2)
print(before, faults(20))
"""


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="only the C library of Linux reads the variable"
)
def test_freed_arrays_are_kept_where_the_environment_of_a_dask_worker_forbids_it():
    environment = {"MALLOC_TRIM_THRESHOLD_": "65536", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", _COUNT], capture_output=True, text=True, check=True, env=environment
    )
    before, after = map(int, done.stdout.split())
    assert before > 20 * 100
    assert after < 20


# `malloc_info` writes an element <heap> for each heap to an open file of C.
_HEAPS = """
import ctypes, os, sys, tempfile
from threading import Thread
from dic.image.memory import share_one_heap

c = ctypes.CDLL(None)
c.fdopen.restype = c.malloc.restype = ctypes.c_void_p


def heaps():
    with tempfile.TemporaryFile() as told:
        stream = ctypes.c_void_p(c.fdopen(os.dup(told.fileno()), b"w"))
        c.malloc_info(0, stream)
        c.fclose(stream)
        told.seek(0)
        return told.read().count(b"<heap nr")


if sys.argv[1] == "shared":
    share_one_heap()
before = heaps()
threads = [Thread(target=lambda: c.free(ctypes.c_void_p(c.malloc(100_000)))) for _ in range(3)]
for thread in threads:
    thread.start()
    thread.join()
print(heaps() - before)
"""


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="only the C library of Linux has heaps of threads"
)
@pytest.mark.parametrize("kind", ["shared", "own"])
def test_threads_take_their_memory_from_one_heap_if_they_shall(kind):
    done = subprocess.run([sys.executable, "-c", _HEAPS, kind], capture_output=True, text=True, check=True)
    assert (int(done.stdout) == 0) == (kind == "shared")
