"""List the serial ports of this computer, and ask a device at a port one question."""

from pathlib import Path

from drivers.clock import SystemClock
from drivers.lines.addresses import lasting_names
from drivers.lines.channel import Channel, open_channel
from drivers.registry import SerialPort

ANSWER_S = 0.3
"""Longest wait for the answer to a question, in seconds."""


def serial_ports(root: Path = Path("/")) -> list[SerialPort]:
    """Return the serial ports that have real hardware.

    `root` is the folder that contains the system's folder ``dev``. Tests give another folder.
    """
    from serial.tools import list_ports

    by_id, by_path = lasting_names(root / "dev/serial/by-id"), lasting_names(root / "dev/serial/by-path")
    ports = []
    for port in sorted(list_ports.comports()):
        # without serial numbers, all adapters of one model have the same name in by-id, so use by-path
        lasting = by_id if port.serial_number else by_path
        ports.append(SerialPort(lasting.get(Path(port.device).name, port.device), port.description))
    return ports


def lines_answered(url: str, baud: int, question: bytes) -> list[bytes]:
    """Send a question to a serial port or ``socket://host:port`` and return the lines of the answer.

    Raise `OSError` if the port cannot be opened or used, for example because another program uses the port.
    """
    channel = open_channel(url, baud, ANSWER_S)
    try:
        channel.drain()
        channel.send(question)
        return [line for line in _all(channel).replace(b"\r", b"\n").split(b"\n") if line]
    finally:
        channel.close()


def _all(channel: Channel) -> bytes:
    received = b""
    end_s = SystemClock().now_s() + ANSWER_S
    while data := channel.receive(end_s):
        received += data
    return received
