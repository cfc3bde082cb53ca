"""Files that several test modules read: made by the first worker that needs them, shared by all workers."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return the folder that `make(folder)` has filled once in this run of the tests.

    Another worker that asks for the same name waits until the folder is complete. The tests only read it: one
    that changes a file works on a copy.
    """
    own = tmp_path_factory.getbasetemp()
    # Each of several workers has a folder of its own in the folder of all.
    everything = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "made_once"
    everything.mkdir(exist_ok=True)
    folder = everything / name
    with (everything / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            unfinished = tmp_path_factory.mktemp(name)
            make(unfinished)
            unfinished.rename(folder)
    return folder
