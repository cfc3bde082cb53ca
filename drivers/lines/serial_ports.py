"""What is plugged into this machine that may be a device of a rig: video nodes and serial ports."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FoundCamera:
    """A camera.

    Attributes
    ----------
    driver : str
        The one that films with it.
    place : str
        What a rig file calls it. Lasting, where the system keeps such a name: that of the socket, or else
        that of the camera. Two cameras of a kind may have one name between them, but never one socket.
    name : str
        As the camera or its kernel driver says.
    """

    driver: str
    place: str
    name: str


@dataclass(frozen=True)
class SerialPort:
    """A serial port.

    Attributes
    ----------
    path : str
        Lasting, where the system keeps one.
    description : str
        As the adapter says.
    """

    path: str
    description: str


def video_nodes(root: Path = Path("/")) -> list[FoundCamera]:
    """Return the cameras' nodes; of a camera with several, the one for pictures.

    Parameters
    ----------
    root : Path
        Where the system's ``sys`` and ``dev`` are.
    """
    lasting = _lasting(root / "dev/v4l/by-id") | _lasting(root / "dev/v4l/by-path")
    nodes = []
    for folder in sorted((root / "sys/class/video4linux").glob("video*"), key=_number):
        # a camera's further nodes give metadata
        if _text(folder / "index") in ("", "0"):
            plain = f"/dev/{folder.name}"
            place = lasting.get(folder.name, plain)
            nodes.append(FoundCamera("v4l2", place, _text(folder / "name")))
    return nodes


def serial_ports(root: Path = Path("/")) -> list[SerialPort]:
    """Return the serial ports that have hardware behind them."""
    from serial.tools import list_ports

    by_id, by_path = _lasting(root / "dev/serial/by-id"), _lasting(root / "dev/serial/by-path")
    ports = []
    for port in sorted(list_ports.comports()):
        # adapters of a kind without serial numbers have one name between them
        lasting = by_id if port.serial_number else by_path
        ports.append(SerialPort(lasting.get(Path(port.device).name, port.device), port.description))
    return ports


def _lasting(folder: Path) -> dict[str, str]:
    """Return a folder's links by the name of the node each leads to."""
    if not folder.is_dir():
        return {}
    return {link.resolve().name: str(link) for link in sorted(folder.iterdir(), reverse=True)}


def _number(folder: Path) -> int:
    digits = folder.name.removeprefix("video")
    return int(digits) if digits.isdecimal() else 0


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
