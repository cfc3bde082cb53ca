"""A program that opens a machine holds its lock, and another program's error message names the first one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rig.errors import RigError
from rig.guardian.lock import lock_path, machines_locked
from rig.rigfile import RigFile, read_rig
from tests.rig.guardian.stopping import RIG, SIMULATION


@pytest.fixture
def rig_at(tmp_path):
    def read(stage: str, load_frame: str) -> RigFile:
        text = RIG.replace('port = "@{stage}"', f'port = "{stage}"')
        text = text.replace('address = "@{load_frame}"', f'address = "{load_frame}"')
        path = tmp_path / "rig.toml"
        path.write_text(text.replace(SIMULATION, ""))
        return read_rig(path)

    return read


def test_the_second_program_is_told_who_holds_the_machine(rig_at, tmp_path):
    rig_file = rig_at("/dev/ttyUSB0", "10.0.0.8:502")
    with machines_locked(rig_file, tmp_path):
        with pytest.raises(RigError) as refused, machines_locked(rig_file, tmp_path):
            pass
        sentence = str(refused.value)
        assert sentence.startswith(
            "load_frame (10.0.0.8:502): expected a machine that no other program commands"
        )
        assert f"pid {os.getpid()} (" in sentence
        assert Path(sys.argv[0]).name in sentence
    with machines_locked(rig_file, tmp_path):
        pass


def test_one_place_is_one_machine_whatever_it_is_called(rig_at, tmp_path):
    port = tmp_path / "ttyUSB0"
    port.touch()
    (tmp_path / "by-id").symlink_to(port)
    with machines_locked(rig_at(str(port), "10.0.0.8:502"), tmp_path):
        for stage, load_frame in (
            (str(tmp_path / "by-id"), "10.0.0.9:502"),
            ("/dev/ttyUSB7", "rtu://10.0.0.8:502"),
            ("socket://10.0.0.8:502", "10.0.0.9:502"),
        ):
            with (
                pytest.raises(RigError, match="no other program"),
                machines_locked(rig_at(stage, load_frame), tmp_path),
            ):
                pass
        with machines_locked(rig_at("/dev/ttyUSB7", "10.0.0.9:502"), tmp_path):
            pass


def test_a_refused_rig_leaves_its_other_machines_free(rig_at, tmp_path):
    with machines_locked(rig_at("/dev/ttyUSB0", "10.0.0.8:502"), tmp_path):
        with pytest.raises(RigError), machines_locked(rig_at("/dev/ttyUSB0", "10.0.0.9:502"), tmp_path):
            pass
        with machines_locked(rig_at("/dev/ttyUSB1", "10.0.0.9:502"), tmp_path):
            pass


def test_a_process_that_inherits_the_lock_keeps_it(rig_at, tmp_path):
    rig_file = rig_at("/dev/ttyUSB0", "10.0.0.8:502")
    with machines_locked(rig_file, tmp_path) as locks:
        heir = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=locks)
    with pytest.raises(RigError, match="no other program"), machines_locked(rig_file, tmp_path):
        pass
    heir.communicate(b"\n")
    with machines_locked(rig_file, tmp_path):
        pass


def test_machines_inside_this_program_need_no_lock(rig_at, tmp_path):
    rig_file = rig_at("@stage", "@load_frame")
    with machines_locked(rig_file, tmp_path) as locks, machines_locked(rig_file, tmp_path):
        assert locks == []


def test_a_lock_file_that_cannot_be_opened_is_one_sentence(rig_at, tmp_path):
    lock_path("10.0.0.8:502", tmp_path).symlink_to(tmp_path / "elsewhere")
    with (
        pytest.raises(RigError, match="expected a lock file that can be opened"),
        machines_locked(rig_at("/dev/ttyUSB0", "10.0.0.8:502"), tmp_path),
    ):
        pass
