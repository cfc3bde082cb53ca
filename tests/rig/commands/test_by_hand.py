"""`rig status`, `rig hold`, `rig unload` and `rig jog` on the virtual rig, and on a rig that is in use."""

import os
from contextlib import closing

import pytest

from rig.guardian.lock import machines_locked
from rig.rigfile import read_rig
from tests.command_line import RIG, run_rig
from tests.screens import TerminalProgram

RIG_FILE = """
[rig]
name = "by hand"
[simulation]
driver = "virtual-rig"
[cameras.broken]
driver = "v4l2"
device = "/dev/video-that-does-not-exist"
width_px = 640
height_px = 480
rate_hz = 10.0
[load_frame]
driver = "modbus-frame"
address = "@load_frame"
load_max_n = 14000.0
displacement_max_mm = 6.0
[stage]
driver = "zaber-ascii"
port = "@stage"
angle_min_deg = -5.0
angle_max_deg = 365.0
[operator]
driver = "simulated-operator"
"""


@pytest.fixture
def rig_file(tmp_path, monkeypatch):
    path = tmp_path / "rig.toml"
    path.write_text(RIG_FILE)
    monkeypatch.chdir(tmp_path)
    return path


def test_status_says_what_holds_and_needs_no_camera(rig_file, tmp_path):
    done = run_rig("status", rig_file, "--json", tmp_path / "status.json")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("The load frame holds at ")
    assert "; the stage stands at 0.00 deg, without a reference position." in done.out
    assert done.report["load_frame"]["holding"] is True
    assert done.report["in_use"] == ""


def test_status_goes_on_after_a_device_that_fails(rig_file, tmp_path):
    rig_file.write_text(RIG_FILE.replace('"@load_frame"', '"127.0.0.1:1"'))
    done = run_rig("status", rig_file, "--json", tmp_path / "status.json")
    assert done.status == 1
    assert "127.0.0.1:1" in done.err
    assert "The stage stands at 0.00 deg" in done.out
    assert "the load frame does not answer, so nobody knows whether it moves" in done.out
    assert list(done.report["silent"]) == ["load_frame"]


def test_hold_needs_no_word_and_says_what_holds(rig_file):
    done = run_rig("hold", rig_file)
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("completed: The load frame holds at ")


def test_hold_stops_the_stage_even_if_the_load_frame_does_not_answer(rig_file):
    rig_file.write_text(RIG_FILE.replace('"@load_frame"', '"127.0.0.1:1"'))
    done = run_rig("hold", rig_file)
    assert done.status == 2
    assert done.err.startswith("rig: SAFE STATE NOT CONFIRMED, use the emergency stop (load_frame")
    assert "the stage stands at 0.00 deg" in done.out.casefold()


def test_jog_moves_and_says_what_holds(rig_file, tmp_path):
    done = run_rig("jog", rig_file, "--load-n", "2000", "--yes", "--json", tmp_path / "jog.json")
    assert (done.status, done.err) == (0, "")
    assert done.report["status"] == "completed"
    assert done.report["at_end"]["load_frame"]["load_n"] == pytest.approx(2000.0, abs=28.0)
    done = run_rig("jog", rig_file, "--displacement-mm", "0.1", "--relative", "--yes")
    assert done.status == 0


def test_unload_moves_nothing_without_a_confirmation(rig_file):
    read, write = os.pipe()
    os.close(write)
    stdin = os.dup(0)
    os.dup2(read, 0)
    try:
        done = run_rig("unload", rig_file)
    finally:
        os.dup2(stdin, 0)
        os.close(stdin)
        os.close(read)
    assert done.status == 2
    assert "confirm beforehand with --yes" in done.err
    assert "failed: The load frame holds at " in done.out


@pytest.mark.parametrize("arguments", [(), ("--load-n", "1", "--angle-deg", "1")])
def test_jog_takes_exactly_one_axis(rig_file, arguments):
    done = run_rig("jog", rig_file, *arguments)
    assert done.status == 2
    assert "give exactly one of" in done.err


@pytest.mark.parametrize(
    "arguments",
    [
        ("--angle-deg", "1", "--rate", "1"),
        ("--angle-deg", "1", "--travel-max-mm", "1"),
        ("--displacement-mm", "1", "--travel-max-mm", "1"),
    ],
)
def test_an_option_without_effect_on_the_axis_is_refused(rig_file, arguments):
    done = run_rig("jog", rig_file, *arguments, "--yes")
    assert done.status == 2
    assert f"give {arguments[2]} only with" in done.err


def test_a_rig_without_the_device_is_refused_in_one_sentence(rig_file):
    head, _, tail = RIG_FILE.partition("[stage]")
    rig_file.write_text(head + "[operator]" + tail.partition("[operator]")[2])
    done = run_rig("jog", rig_file, "--angle-deg", "1", "--yes")
    assert (done.status, done.out) == (2, "")
    assert "moving the angle: expected a [stage] in the rig file, got none" in done.err


def test_a_rig_that_another_program_uses_is_not_touched(rig_file, tmp_path):
    rig_file.write_text(RIG_FILE.replace('"@load_frame"', '"127.0.0.1:1"'))
    with machines_locked(read_rig(rig_file)):
        status = run_rig("status", rig_file, "--json", tmp_path / "status.json")
        hold = run_rig("hold", rig_file)
        jog = run_rig("jog", rig_file, "--load-n", "1", "--yes")
    assert (status.status, hold.status, jog.status) == (1, 2, 2)
    assert f"is in use by pid {os.getpid()}" in status.out
    assert status.report["in_use"]
    assert "press Ctrl-C in that program" in hold.err
    assert "expected a machine that no other program commands" in jog.err


@pytest.mark.realtime
def test_a_person_confirms_with_a_word_and_stops_with_ctrl_c(rig_file, tmp_path):
    real = RIG_FILE.replace('driver = "virtual-rig"', 'driver = "virtual-rig"\nreal_time = true')
    rig_file.write_text(real)
    command = [*RIG, "jog", str(rig_file), "--displacement-mm", "1.0"]
    with closing(TerminalProgram(command, 80, tmp_path)) as jog:
        jog.wait_for("Type move to begin, Ctrl-C to leave all as it is:")
        jog.type("yes\n")
        jog.wait_for('"yes" is not the word.')
        jog.type("move\n")
        shown = jog.wait_for("MOVES: go from ")
        assert "Ctrl-C: the load frame holds" in shown
        jog.type("\x03")
        assert jog.end() == 1
        # a long sentence continues in the next line of the terminal
        shown = str(jog.screen).replace("\n", "")
    assert "got SIGINT" in shown
    assert "aborted: The load frame holds at " in shown
