"""Fixtures with a running simulation, the log of its true state, and the rig opened from its rig file."""

import threading

import pytest

from rig.devices import open_rig
from rig.rigfile import read_rig
from simulators.rig.simulation import Simulation
from tests.simulators.small_rig import TABLES


@pytest.fixture
def log(tmp_path):
    return tmp_path / "truth.jsonl"


@pytest.fixture
def simulation(log):
    before = set(threading.enumerate())
    started = Simulation(TABLES, "rig.toml", log)
    yield started
    started.close()
    started.close()
    assert set(threading.enumerate()) <= before


@pytest.fixture
def rig(simulation, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(simulation.rig_file(), encoding="utf-8")
    with open_rig(read_rig(path)) as opened:
        yield opened
