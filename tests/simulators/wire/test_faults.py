"""Tests of the effect of each fault on the bytes that a client receives."""

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from drivers.clock import VirtualClock
from simulators.stage.device import StageDevice
from simulators.stage.faults import stage_faults
from simulators.stage.zaber import ZaberServer
from simulators.wire.faults import FAULTS, FaultPanel, names, parse
from simulators.wire.line import Line
from simulators.wire.rig_faults import RigFaults
from tests.simulators.terminal import listen, terminal_of
from tests.tcp_servers import zaber_on_tcp

FIRST, SECOND = b"@01 0 00 OK IDLE WR 0:BE\r\n", b"@01 0 01 OK IDLE WR 0:BD\r\n"
"""Answers to `get pos` with the ids 00 and 01; the checksums follow from the vendor's rule."""


@pytest.fixture
def server(serve):
    return serve(ZaberServer(StageDevice(VirtualClock())))


def talk(server: ZaberServer, messages: list[bytes], sizes: list[int]) -> list[bytes]:
    """Send messages one after the other, and return the bytes received after each of them."""
    with terminal_of(server.address) as terminal:
        answers = []
        for message, size in zip(messages, sizes, strict=True):
            os.write(terminal, message)
            answers.append(listen(terminal, size))
        return answers


@pytest.mark.parametrize(
    ("fault", "answers"),
    [
        ("lose-request:1", [b"", SECOND]),
        ("drop:1", [b"", SECOND]),
        ("duplicate:1", [FIRST + FIRST, SECOND]),
        ("late", [b"", FIRST]),
        ("late:1", [b"", FIRST + SECOND]),
        ("stale", [b"", FIRST]),
        ("split", [FIRST, SECOND]),
        ("delay:0.01", [FIRST, SECOND]),
        ("wrong-unit:1", [b"@02 0 00 OK IDLE WR 0:BD\r\n", SECOND]),
        ("reject:AGAIN:1", [b"@01 0 00 RJ IDLE WR AGAIN:8C\r\n", SECOND]),
    ],
)
def test_what_comes_after_two_questions(server, fault, answers):
    server.faults.switch_on(fault)
    questions = [b"/1 0 00 get pos:2D\n", b"/1 0 01 get pos:2C\n"]
    assert talk(server, questions, [len(answer) for answer in answers]) == answers


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("drop:1", [SECOND]),
        ("delay:0.25:1", ["0.25", FIRST, SECOND]),
        ("delay", ["0.02", FIRST, "0.02", SECOND]),
        # 26 bytes in three pieces, a pause before each but the first
        ("split:1", [FIRST[:9], "0.002", FIRST[9:18], "0.002", FIRST[18:], SECOND]),
    ],
)
def test_when_and_in_how_many_pieces_an_answer_comes(server, fault, expected):
    happened = []
    line = Line(server, happened.append, lambda seconds: happened.append(f"{seconds:g}"))
    server.faults.switch_on(fault)
    line.receive(b"/1 0 00 get pos:2D\n/1 0 01 get")
    line.receive(b" pos:2C\n")
    assert happened == expected


def test_a_damaged_answer_has_the_right_length_and_a_wrong_checksum(server):
    server.faults.switch_on("corrupt")
    (damaged,) = talk(server, [b"/1 0 00 get pos:2D\n"], [len(FIRST)])
    assert len(damaged) == len(FIRST)
    assert sum(a != b for a, b in zip(damaged, FIRST, strict=True)) == 1


def test_a_dropped_answer_is_to_a_command_that_was_executed(server):
    server.faults.switch_on("drop")
    talk(server, [b"/1 1 00 move abs 6400\n"], [0])
    assert [name for _, name in server.device.executed] == ["move 6400"]
    server.faults.clear()
    server.faults.switch_on("lose-request")
    talk(server, [b"/1 1 00 move abs 12800\n"], [0])
    assert len(server.device.executed) == 1


def test_an_unplugged_terminal_is_gone_and_comes_back_under_its_name(server):
    with terminal_of(server.address) as terminal:
        server.faults.switch_on("unplug")
        with pytest.raises(OSError, match=r"\[Errno 5\]"):
            os.write(terminal, b"/\n")
        with pytest.raises(FileNotFoundError), terminal_of(server.address):
            pass
    server.faults.clear("unplug")
    assert talk(server, [b"/1 0 00 get pos:2D\n"], [len(FIRST)]) == [FIRST]


def test_what_a_killed_simulation_left_behind_is_swept_away(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    script = (
        "import os, signal\n"
        "from drivers.clock import VirtualClock\n"
        "from simulators.stage.device import StageDevice\n"
        "from simulators.stage.zaber import ZaberServer\n"
        "print(ZaberServer(StageDevice(VirtualClock())).address, flush=True)\n"
    )
    run = [sys.executable, "-c"]
    killed = subprocess.run([*run, script + "os.kill(os.getpid(), signal.SIGKILL)"], capture_output=True)
    left = Path(killed.stdout.decode().strip()).parent
    assert left.parent == tmp_path
    assert left.exists()
    subprocess.run([*run, script], check=True, capture_output=True)
    assert not left.exists()


@pytest.mark.parametrize("name", ["e-stop", "limit", "reset", "stall"])
def test_faults_of_the_stage_end_its_motion(name, serve):
    clock = VirtualClock()
    device = StageDevice(clock)
    server = serve(ZaberServer(device))
    device.move_to(640_000)
    clock.sleep(1.0)
    assert device.moving
    server.faults.switch_on(name)
    assert not device.moving
    assert 0.0 < device.angle_deg() < 100.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("dorp", "expected one of lose-request, drop"),
        ("drop:x", r"expected drop\[:COUNT\]"),
        ("drop:0", r"expected drop\[:COUNT\]"),
        ("drop:1:2", r"expected drop\[:COUNT\]"),
        ("drop:²", r"expected drop\[:COUNT\]"),
        ("drop:" + "9" * 5000, r"expected drop\[:COUNT\]"),
        ("delay:soon", "with a number from 0 to 3600, got 'soon'"),
        ("delay:1e3", "with a number from 0 to 3600"),
        ("delay:99999", "with a number from 0 to 3600"),
        ("delay:", "with a number from 0 to 3600"),
        ("reject:", "with one word of letters"),
        ("reject:NOT NOW", "with one word of letters"),
        ("reject:BESCHÄFTIGT", "with one word of letters"),
        ("delay:1:2:3", r"expected delay\[:SECONDS\]\[:COUNT\]"),
        ("unplug:1", "expected unplug"),
        ("nan-load", "expected one that stage can have"),
    ],
)
def test_a_fault_that_is_none_is_refused(text, said):
    panel = FaultPanel("stage")
    with pytest.raises(ValueError, match=said):
        panel.switch_on(text)
    assert panel.active == []


@pytest.mark.parametrize("code", ["0", "256", "6.5"])
def test_a_code_that_does_not_fit_into_an_answer_is_refused(code):
    with pytest.raises(ValueError, match="with a number from 1 to 255"):
        FaultPanel("load_frame").switch_on(f"exception:{code}")


def test_counted_faults_are_used_up_and_others_stay():
    panel = FaultPanel("load_frame")
    panel.switch_on("exception:4:2")
    assert [panel.take("exception") for _ in range(3)] == ["4", "4", None]
    panel.switch_on("drop")
    assert [panel.take("drop") for _ in range(3)] == ["", "", ""]


def test_effects_come_once_and_go_when_cleared():
    happened = []
    panel = FaultPanel("load_frame")
    panel.when("e-stop", lambda: happened.append("pressed"), lambda: happened.append("released"))
    for text in ("e-stop", "e-stop"):
        panel.switch_on(text)
    panel.clear("drop")
    assert (happened, panel.active) == (["pressed"], ["e-stop"])
    panel.clear()
    panel.clear()
    assert happened == ["pressed", "released"]


def test_what_is_over_at_once_happens_again():
    happened = []
    panel = FaultPanel("stage")
    panel.when("reset", lambda: happened.append("reset"))
    panel.switch_on("reset")
    panel.switch_on("reset")
    panel.clear()
    assert happened == ["reset", "reset"]


def test_a_stage_may_be_reset_a_second_time():
    clock = VirtualClock()
    device = StageDevice(clock)
    panel = stage_faults(FaultPanel("stage"), device)
    for _ in range(2):
        device.home()
        clock.sleep(100.0)
        assert "WR" not in device.flags
        panel.switch_on("reset")
        assert "WR" in device.flags


def test_a_port_that_another_program_took_meanwhile_is_said_and_comes_back_later(serve):
    server = serve(zaber_on_tcp(StageDevice(VirtualClock())))
    server.faults.switch_on("unplug")
    host, port = server.address.split(":")
    with socket.create_server((host, int(port))), pytest.raises(OSError, match="in use"):
        server.faults.clear()
    assert server.faults.active == ["unplug"]
    server.faults.clear()
    assert server.faults.active == []
    socket.create_connection((host, int(port)), 10.0).close()


def test_a_fault_that_is_just_being_switched_on_is_cleared_after_that():
    happened = []
    panel = FaultPanel("stage")
    clearing = threading.Thread(target=panel.clear)

    def unplug() -> None:
        clearing.start()
        # it would be done by now, if it did not wait its turn
        clearing.join(0.1)
        happened.append("unplugged")

    panel.when("unplug", unplug, lambda: happened.append("plugged in"))
    panel.switch_on("unplug")
    clearing.join()
    assert (happened, panel.active) == (["unplugged", "plugged in"], [])


def test_a_rigs_faults_are_named_with_their_device():
    faults = RigFaults(FaultPanel("stage"), FaultPanel("load_frame"))
    faults.switch_on("stage.drop:2")
    faults.switch_on("load_frame.nan-load")
    assert faults.active == ["stage.drop", "load_frame.nan-load"]
    faults.clear("stage")
    assert faults.active == ["load_frame.nan-load"]
    for wrong in ("drop", "camera.drop", "stage.dorp"):
        with pytest.raises(ValueError, match="expected"):
            faults.switch_on(wrong)
    with pytest.raises(ValueError, match="expected one of"):
        faults.clear("stage.dorp")


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_can_be_written_as_it_is_listed(name):
    fault, _, count = parse(name)
    assert (fault.name, count) == (name, None)
    assert all(name in names(device) for device in fault.devices)
