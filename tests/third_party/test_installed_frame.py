"""A third party's load frame without control of the load: contract, plan, run, and a killed run."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from tests.places import example
from tests.third_party.heron_frame.heron_machine import HeronMachine

pytestmark = pytest.mark.extended

PACKAGE = Path(__file__).parent / "heron_frame"
OFFLINE = ("--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check", "--quiet")
RIG = (sys.executable, "-c", "from rig.cli import main; main()")
END_S = 120.0
KILLED_S = 0.05
"""Longest time from a kill to the standstill, as for the drivers of offaxis."""
RIG_FILE = """
[rig]
name = "small frame"
[simulation]
driver = "virtual-rig"
real_time = true
[load_frame]
driver = "heron-frame"
port = "{port}"
load_max_n = 14000.0
displacement_max_mm = 6.0
[cameras.front]
driver = "simulated-camera"
width_px = 48
height_px = 32
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
PROTOCOL = """
kind = "phases"
title = "displacements only"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 60.0
[[phases]]
do = "to-displacement"
displacement_mm = {target_mm}
speed_mm_s = 0.2
images.every_mm = {every_mm}
[start]
tare_max_n = 100.0
[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 0.1
timeout_s = 30.0
poll_s = 0.1
[limits]
load_max_n = 13000.0
displacement_max_mm = 2.5
break_load_drop = 0.3
[plausible]
modulus_min_mpa = 5000.0
machine_stiffness_max_n_mm = 20000.0
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder in which the third party's package is installed."""
    source, folder = tmp_path_factory.mktemp("source") / "heron", tmp_path_factory.mktemp("packages")
    shutil.copytree(PACKAGE, source)
    command = [sys.executable, "-m", "pip", "install", *OFFLINE, "--target", str(folder), str(source)]
    subprocess.run(command, check=True, timeout=300)
    return folder


@pytest.fixture
def machine(tmp_path) -> Iterator[HeronMachine]:
    with closing(HeronMachine(SystemClock())) as machine:
        (tmp_path / "rig.toml").write_text(RIG_FILE.format(port=machine.address))
        (tmp_path / "pull.toml").write_text(PROTOCOL.format(target_mm=0.4, every_mm=0.2))
        yield machine


@pytest.fixture
def started(installed, tmp_path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """A function that starts a program with the third party's package."""
    programs: list[subprocess.Popen[str]] = []

    def start(*command: object) -> subprocess.Popen[str]:
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "COV"))}
        path = os.pathsep.join([str(installed), *filter(None, [environment.get("PYTHONPATH")])])
        programs.append(
            subprocess.Popen(
                [str(part) for part in command],
                cwd=tmp_path,
                env=environment | {"PYTHONPATH": path},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        return programs[-1]

    yield start
    for program in programs:
        with program:
            program.kill()


def ended(program: subprocess.Popen[str]) -> tuple[int, str]:
    said, _ = program.communicate(timeout=END_S)
    return program.returncode, said


def test_it_is_held_to_the_contract(started, tmp_path):
    # outside this checkout, so that its conftest and its settings do not count
    contract = shutil.copy(PACKAGE / "keeps_contract.py", tmp_path)
    shutil.copy(PACKAGE / "heron_machine.py", tmp_path)
    status, said = ended(started(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", contract))
    assert status == 0, said
    assert " passed" in said


def test_a_run_moves_it_to_displacements(machine, started):
    status, said = ended(started(*RIG, "run", "pull.toml", "--rig", "rig.toml", "-o", "run.h5"))
    assert status == 0, said
    assert machine.device.displacement_mm() == pytest.approx(0.4, abs=0.002)
    assert "no guardian can stop it" not in said


def test_a_protocol_with_loads_is_refused_before_anything_moves(machine, started, tmp_path):
    (tmp_path / "tension.toml").write_text(example("tension"))
    for command in (
        ("plan", "tension.toml", "--rig", "rig.toml"),
        ("run", "tension.toml", "--rig", "rig.toml"),
    ):
        status, said = ended(started(*RIG, *command))
        assert status != 0
        assert "loading.rate_n_s: a load frame that controls the load is needed" in said
        assert "Traceback" not in said
    status, said = ended(started(*RIG, "unload", "rig.toml", "--yes"))
    assert status != 0
    assert "expected a load frame that controls the load" in said
    assert machine.motions == 0


@pytest.mark.realtime
def test_a_killed_run_leaves_it_standing(machine, started, tmp_path):
    (tmp_path / "pull.toml").write_text(PROTOCOL.format(target_mm=2.0, every_mm=2.0))
    run = started(*RIG, "run", "pull.toml", "--rig", "rig.toml", "-o", "run.h5")
    end_s = time.monotonic() + END_S
    while machine.motions == 0 or not machine.device.read().moving:
        assert run.poll() is None, run.communicate()[0]
        assert time.monotonic() < end_s
        time.sleep(0.01)
    time.sleep(0.3)
    killed_s = time.monotonic()
    run.kill()
    while machine.device.read().moving:
        assert time.monotonic() < killed_s + 10.0, "it moves on"
        time.sleep(0.001)
    stood_s = time.monotonic()
    assert 0.0 < machine.device.displacement_mm() < 2.0
    _, said = ended(run)
    assert "rig guardian: the process of the run is gone: load_frame stopped, confirmed" in said
    assert stood_s - killed_s <= KILLED_S
