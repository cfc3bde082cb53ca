"""A time limit that is hit fails one test, wherever the signal arrives, and the other tests go on."""

import subprocess
import sys

from tests.places import ROOT

HIT = """
import signal, time, types

import pytest

pytest_plugins = ("tests.limits",)


def wait(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass


# Its table of lines says "no location" (0xff: for 8 instructions), as for code that Python itself inserts.
code = wait.__code__
nowhere = types.FunctionType(code.replace(co_linetable=b"\\xff" * len(code.co_code)), globals())


@pytest.mark.timeout(0.2)
@pytest.mark.parametrize("waiting", [wait, nowhere])
def test_hangs(waiting):
    waiting(60)


@pytest.fixture
def slow():
    nowhere(60)


@pytest.mark.timeout(0.2)
def test_hangs_in_a_fixture(slow):
    pass


def test_goes_on():
    pass
"""


def test_limit_that_is_hit_fails_one_test_and_not_the_run(tmp_path):
    (tmp_path / "test_hit.py").write_text(HIT)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-o", "timeout_method=signal",
         "--rootdir", tmp_path, tmp_path / "test_hit.py"],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert "2 failed, 1 passed, 1 error" in done.stdout, done
    assert "INTERNALERROR" not in done.stdout
