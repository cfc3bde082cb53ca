"""However a run ends, exactly one message is sent."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.interfaces import LoadFrameState, StageState
from rig.engine.status import AtRest, Outcome
from rig.errors import ProtocolError
from rig.news.message import Messenger, message_of_end, split_command
from rig.news.messenger import send
from rig.news.wording import About
from rig.notifying import NewsSettings

ABOUT = About("run-1", "/data/run.h5", "A test", "tension", True, ("left",))
FRAME = LoadFrameState(7001.2, 0.61234, False, True, True, 9, (), 3.0)


@pytest.fixture
def command(tmp_path) -> str:
    """A command that records its argument, an environment variable and its standard input at each call."""
    script = tmp_path / "note"
    script.write_text(
        f'#!/bin/sh\n{{ echo "$1"; echo "$OFFAXIS_STATUS"; cat; echo ---; }} >> \'{tmp_path}/notes\'\n'
    )
    script.chmod(0o755)
    return f"'{script}' {{subject}}"


def notes(folder: Path) -> list[str]:
    path = folder / "notes"
    return path.read_text().split("---\n")[:-1] if path.exists() else []


def test_the_message_says_how_it_ended_what_holds_and_that_it_was_simulated(command, tmp_path):
    outcome = Outcome("failed", "the lamp is out", 7, at_end=AtRest(FRAME, None, {"stage": "no answer"}))
    messenger = Messenger(NewsSettings(notify=command), ABOUT)
    assert messenger.send(message_of_end(ABOUT, outcome, 12)) == []
    [note] = notes(tmp_path)
    argument, status, *text = note.splitlines()
    assert argument == "SIMULATED failed: A test"
    assert status == "failed"
    assert text[:4] == [
        "SIMULATED failed: A test",
        "Reason: the lamp is out",
        "7 of 12 planned steps are in /data/run.h5",
        "At the end: the load frame holds, at 7001.2 N and 0.6123 mm; stage does not answer",
    ]


def test_a_real_run_is_not_called_simulated():
    about = About("run-1", "/data/run.h5", "A test", "rotation", False, ())
    stage = StageState(45.0, False, True, (), 3.0)
    message = message_of_end(about, Outcome("completed", "", 7, at_end=AtRest(None, stage)), 7)
    assert message["subject"] == "completed: A test"
    assert "At the end: the stage is at 45.000 deg" in message["text"]


def test_there_is_never_a_second_message(command, tmp_path):
    messenger = Messenger(NewsSettings(notify=command), ABOUT)
    message = message_of_end(ABOUT, Outcome("completed", "", 7), 7)
    assert messenger.send(message) == []
    assert messenger.send(message) == []
    assert len(notes(tmp_path)) == 1


def test_a_killed_program_sends_one_message_too(command, tmp_path):
    program = (
        "import os, signal\n"
        "from rig.news.message import Messenger\n"
        "from rig.news.wording import About\n"
        "from rig.notifying import NewsSettings\n"
        f"made = Messenger(NewsSettings(notify={command!r}), {ABOUT!r})\n"
        "print(made._process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == -signal.SIGKILL
    # The messenger is no child of this program, so its end is seen by the lock on its output.
    wait_for_end(int(done.stdout))
    [note] = notes(tmp_path)
    assert note.splitlines()[:2] == ["SIMULATED killed: A test", "killed"]
    assert "Look at the machine" in note


def wait_for_end(pid: int) -> None:
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    with os.fdopen(descriptor) as process:
        import select

        assert select.select([process], [], [], 60.0)[0]


def test_signals_to_the_whole_terminal_do_not_keep_the_message_back(command, tmp_path):
    messenger = Messenger(NewsSettings(notify=command), ABOUT)
    assert messenger.send({**message_of_end(ABOUT, Outcome("aborted", "SIGINT", 3), 7)}) == []
    assert os.getsid(0) != messenger._process.pid
    assert len(notes(tmp_path)) == 1


def test_a_run_that_never_began_sends_none(command, tmp_path):
    Messenger(NewsSettings(notify=command), ABOUT).cancel()
    assert notes(tmp_path) == []


MESSAGE = {"subject": "S", "status": "completed", "text": "T\n", "run_file": "/r", "simulated": "true"}


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["sh", "-c", "echo the server is away >&2; exit 3"], "ended with status 3: the server is away"),
        (["/nowhere/mail"], "cannot be started: No such file or directory"),
        (["true"], ""),
    ],
)
def test_a_failure_of_the_command_is_said(command, said):
    assert send(command, 10.0, MESSAGE) == said


def test_a_command_that_hangs_is_killed_with_all_that_it_started(tmp_path):
    script = f"echo $$ > '{tmp_path}/pid'; sleep 1000 & sleep 1000"
    assert send(["sh", "-c", script], 5.0, MESSAGE) == "did not end within 5 s and was killed"
    wait_for_end(int((tmp_path / "pid").read_text()))


def test_a_large_message_to_a_command_that_does_not_read_does_not_block():
    assert send(["true"], 10.0, {**MESSAGE, "text": "x" * 100_000}) == ""


def test_a_messenger_that_died_is_said(command):
    messenger = Messenger(NewsSettings(notify=command), ABOUT)
    messenger._process.kill()
    messenger._process.wait(60.0)
    [said] = messenger.send(message_of_end(ABOUT, Outcome("completed", "", 7), 7))
    assert "the process that sends the message has died" in said


@pytest.mark.parametrize("command", ["no-such-program-of-ours", "mail 'me", "   "])
def test_a_command_that_cannot_be_called_is_refused_before_the_run(command):
    with pytest.raises(ProtocolError, match="name a program with its path"):
        split_command(command)
