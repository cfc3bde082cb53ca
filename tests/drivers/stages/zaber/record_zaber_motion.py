"""Record the messages between the vendor's client and a stage.

    python -m tests.drivers.stages.zaber.record_zaber_motion INTERPRETER

INTERPRETER is a Python interpreter with the package zaber-motion, preferably in a separate virtual
environment. The transcript is written to the folder `data` beside this file. Each line has one message, byte
for byte: ``>`` marks a message of the client, and ``<`` marks a message of the stage. The tests need neither
the client nor this program.
"""

import subprocess
import sys
from pathlib import Path

from drivers.clock import SystemClock
from simulators.stage.device import StageDevice
from tests.tcp_servers import zaber_on_tcp

TRANSCRIPT = Path(__file__).parent / "data" / "zaber-motion.txt"

# This code runs in a separate process, because the client ends its process after some errors.
CLIENT = """
import sys
from zaber_motion import Library, __version__
from zaber_motion.ascii import Connection

Library.disable_device_db_store()
host, port = sys.argv[1].split(":")
with Connection.open_tcp(host, int(port)) as connection:
    axis = connection.get_device(1).get_axis(1)
    axis.warnings.get_flags()
    axis.home()
    axis.settings.set("maxspeed", 2097152)
    axis.settings.get("limit.max")
    axis.get_position()
    axis.move_absolute(64000)
    axis.move_relative(-6400)
    axis.move_absolute(640000, wait_until_idle=False)
    axis.stop()
    axis.warnings.clear_flags()
    axis.is_busy()
    try:
        axis.move_absolute(10**9)
    except Exception:
        pass
    try:
        axis.settings.get("no.such.setting")
    except Exception:
        pass
print(__version__)
"""


def record(interpreter: str) -> list[str]:
    """Run the client on a simulated stage, and return the lines of the transcript."""
    device = StageDevice(SystemClock(), speed_deg_s=200.0, acceleration_deg_s2=5000.0)
    server = zaber_on_tcp(device)
    lines: list[str] = []
    cut, respond = server.cut, server.respond

    def received(buffer: bytes) -> tuple[list[bytes], bytes]:
        messages, rest = cut(buffer)
        if messages:
            lines.append(f"> {buffer!r}")
        return messages, rest

    def answered(message: bytes) -> bytes:
        reply = respond(message)
        if reply:
            lines.append(f"< {reply!r}")
        return reply

    server.cut, server.respond = received, answered  # type: ignore[method-assign]
    try:
        command = [interpreter, "-c", CLIENT, server.address]
        done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    finally:
        server.close()
    return [f"# zaber-motion {done.stdout.strip()} and the simulated stage", *lines]


if __name__ == "__main__":
    TRANSCRIPT.parent.mkdir(exist_ok=True)
    TRANSCRIPT.write_text("\n".join(record(sys.argv[1])) + "\n")
