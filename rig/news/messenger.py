"""A separate process that sends the one message about the end of a run.

If the program of the run is killed, the standard input of this process ends without a message. The process
then sends a message about the killed program. The process never sends two messages. This module imports only
the standard library, so that the process starts quickly.
"""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from typing import Any

_IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
_SHOWN_MAX = 200
_DYING_S = 1.0


def main() -> None:
    """Read the command and the message from standard input, send the message, and print any error."""
    for number in _IGNORED:
        # Handle the signal with an empty function. SIG_IGN would also apply to the command, which inherits
        # it.
        signal.signal(number, lambda *_: None)
    order = json.loads(sys.stdin.readline())
    line = sys.stdin.readline()
    message = json.loads(line) if line.endswith("\n") else order["if_killed"]
    failure = send(order["command"], order["timeout_s"], message)
    with suppress(OSError):
        print(json.dumps({"failure": failure}), flush=True)


def send(command: list[str], timeout_s: float, message: dict[str, str]) -> str:
    """Call the command once with a message.

    `command` has the parts of the command line. In each part, ``{subject}``, ``{status}``, ``{run_file}`` and
    ``{text}`` are replaced by the values of `message`. After `timeout_s` the command is killed, with
    everything that it has started in its session. The command gets ``text`` of the message on its standard
    input, and every value in a variable ``OFFAXIS_…``. Return an error message, or an empty text if the
    command ended with status 0.
    """
    message = {name: value.replace("\0", " ") for name, value in message.items()}
    environment = {**os.environ, **{f"OFFAXIS_{name.upper()}": value for name, value in message.items()}}
    # Use files in memory, because a pipe could block and the disk may be full.
    with _memory(message["text"]) as given, _memory("") as said:
        try:
            process = subprocess.Popen(
                [_filled(part, message) for part in command],
                stdin=given,
                stdout=said,
                stderr=said,
                env=environment,
                start_new_session=True,
            )
        except OSError as error:
            return f"cannot be started: {error.strerror or error}"
        try:
            status = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            # Wait for a limited time only, because a process that waits for a broken disk cannot be killed.
            with suppress(subprocess.TimeoutExpired):
                process.wait(_DYING_S)
            return f"did not end within {timeout_s:g} s and was killed"
        if status == 0:
            return ""
        said.seek(0)
        words = " ".join(said.read().decode(errors="replace").split())[:_SHOWN_MAX]
        return f"ended with status {status}" + (f": {words}" if words else "")


def _filled(part: str, message: dict[str, str]) -> str:
    for name, value in message.items():
        part = part.replace(f"{{{name}}}", value)
    return part


def _memory(text: str) -> Any:
    file = os.fdopen(os.memfd_create("message"), "w+b", buffering=0)
    file.write(text.encode())
    file.seek(0)
    return file


if __name__ == "__main__":
    main()
