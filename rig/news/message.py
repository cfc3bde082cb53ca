"""The one message at the end of a run, which a command of the user sends."""

import json
import shlex
import shutil
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from rig.engine.status import AtRest, Outcome
from rig.errors import ProtocolError
from rig.news.wording import About
from rig.notifying import NewsSettings

_MARGIN_S = 5.0
"""Time in s that the messenger process may take in addition to the time of the command."""


class Messenger:
    """A process that sends one message: the message that `send` gets, or a message about a killed program.

    The settings must have a command.
    """

    def __init__(self, settings: NewsSettings, about: About) -> None:
        self._timeout_s = settings.notify_timeout_s
        self._command = split_command(settings.notify or "")
        # Option -P prevents Python from importing modules from the current folder.
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "rig.news.messenger"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        order = {
            "command": self._command,
            "timeout_s": self._timeout_s,
            "if_killed": message_of_death(about),
        }
        self._tell(order)

    def send(self, message: dict[str, str]) -> list[str]:
        """Send the message, wait for the command, and return error messages. A second call does nothing."""
        if self._process.stdin is None or self._process.stdin.closed:
            return []
        self._tell(message)
        try:
            said, _ = self._process.communicate(timeout=self._timeout_s + _MARGIN_S)
            failure = json.loads(said)["failure"]
        except subprocess.TimeoutExpired:
            failure = "gave no answer in time"
        except (OSError, ValueError):
            failure = "the process that sends the message has died"
        return [f"the command of notify, {self._command[0]}: {failure}"] if failure else []

    def cancel(self) -> None:
        """End the messenger without a message, because no run has begun."""
        self._process.kill()
        self._process.communicate()

    def _tell(self, table: object) -> None:
        assert self._process.stdin is not None
        # Ignore a messenger that has died, because `send` notices later that it does not answer.
        with suppress(OSError):
            self._process.stdin.write(json.dumps(table).encode() + b"\n")
            self._process.stdin.flush()


def split_command(command: str) -> list[str]:
    """Split a command line into its parts, without a shell.

    Raise `ProtocolError` if the command is no command line, or its program is not found.
    """
    try:
        parts = shlex.split(command)
    except ValueError as error:
        raise _no_command(command, str(error)) from error
    if not parts:
        raise _no_command(command, "nothing")
    if shutil.which(parts[0]) is None:
        raise _no_command(command, f"{parts[0]}, which is not found or cannot be executed")
    return parts


def _no_command(command: str, got: str) -> ProtocolError:
    return ProtocolError(
        f"notify, {command}",
        "a program and its arguments",
        got,
        "name a program with its path, or one in PATH, such as --notify 'mail -s {subject} me@example.org'",
    )


def message_of_end(about: About, outcome: Outcome, steps_planned: int) -> dict[str, str]:
    """Return the message about the end of a run."""
    lines = [f"{about.mark}{outcome.status}: {about.title}"]
    if outcome.reason:
        lines.append(f"Reason: {outcome.reason}")
    lines.append(f"{outcome.steps_done} of {steps_planned} planned steps are in {about.run_file}")
    if rest := _at_rest(outcome.at_end):
        lines.append(f"At the end: {rest}")
    lines += [f"Note: {note}" for note in (*outcome.lost_devices, *outcome.lost_listeners)]
    return _message(about, outcome.status, lines)


def message_of_death(about: About) -> dict[str, str]:
    """Return the message about a program that ended without ending its run."""
    lines = [
        f"{about.mark}killed: {about.title}",
        "Reason: the program of the run died before the end of the run. Look at the machine: the program's "
        "guardian and the machine's watchdog should have stopped it, but nobody has confirmed that.",
        f"The finished steps are in {about.run_file}; if the file does not open, use rig repair.",
    ]
    return _message(about, "killed", lines)


def _message(about: About, status: str, lines: list[str]) -> dict[str, str]:
    return {
        "subject": lines[0],
        "status": status,
        "simulated": "true" if about.simulated else "false",
        "run_file": str(Path(about.run_file).absolute()),
        "text": "\n".join([*lines, f"Computer: {socket.gethostname()}"]) + "\n",
    }


def _at_rest(rest: AtRest) -> str:
    parts = []
    if rest.load_frame is not None:
        frame = rest.load_frame
        holding = "holds" if frame.holding else "does not report that it holds"
        parts.append(f"the load frame {holding}, at {frame.load_n:.1f} N and {frame.displacement_mm:.4f} mm")
    if rest.stage is not None:
        parts.append(f"the stage is at {rest.stage.angle_deg:.3f} deg")
    parts += [f"{device} does not answer" for device in rest.silent]
    return "; ".join(parts)
