"""The serial ports of this machine, and what is answered at one."""

from pathlib import Path

from drivers.clock import SystemClock
from drivers.lines.addresses import lasting_names
from drivers.lines.channel import Channel, open_channel
from drivers.registry import SerialPort

ANSWER_S = 0.3
"""How long the answer to a question may take."""


def serial_ports(root: Path = Path("/")) -> list[SerialPort]:
    """Return the serial ports that have hardware behind them.

    Parameters
    ----------
    root : Path
        Where the system's ``dev`` is.
    """
    from serial.tools import list_ports

    by_id, by_path = lasting_names(root / "dev/serial/by-id"), lasting_names(root / "dev/serial/by-path")
    ports = []
    for port in sorted(list_ports.comports()):
        # adapters of a kind without serial numbers have one name between them
        lasting = by_id if port.serial_number else by_path
        ports.append(SerialPort(lasting.get(Path(port.device).name, port.device), port.description))
    return ports


def lines_answered(url: str, baud: int, question: bytes) -> list[bytes]:
    """Send a question to a serial port or ``socket://host:port`` and return the lines that are answered.

    Raises
    ------
    OSError
        If the port cannot be opened or used; another program may hold it.
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
