"""The C library keeps freed memory for the next image where its environment forbids this."""

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
