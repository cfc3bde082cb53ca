"""What is plugged in, who answers, and a rig file to start from: the work of ``rig devices``."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.discover import SerialPort, VideoNode, serial_ports, video_nodes
from drivers.probe import Found, probe_modbus_tcp, probe_serial
from rig.errors import RigError

MODBUS_PORT = 502

# What a person has to decide: without it the rig file is refused, and the message names each.
_TO_DECIDE = {
    "camera": "format, width_px, height_px, rate_hz, exposure_us: as the camera offers and the test needs",
    "stage": "angle_min_deg, angle_max_deg: how far the stage may turn",
    "load_frame": "load_max_n, displacement_max_mm: what the specimen and the machine may bear",
}


@dataclass
class Search:
    """What a search found.

    Attributes
    ----------
    cameras : list of VideoNode
    ports : list of (SerialPort, list of Found, str)
        The last is why a port could not be asked; empty if it was, or should not be.
    hosts : list of (str, list of Found)
    """

    cameras: list[VideoNode] = field(default_factory=list)
    ports: list[tuple[SerialPort, list[Found], str]] = field(default_factory=list)
    hosts: list[tuple[str, list[Found]]] = field(default_factory=list)

    @property
    def found(self) -> list[Found]:
        """Every device that answered."""
        lists = [found for _, found, _ in self.ports] + [found for _, found in self.hosts]
        return [each for found in lists for each in found]

    def lines(self) -> list[str]:
        """Return what was found, a line for each."""
        lines = [f"camera {node.path}: {node.name or 'no name'}" for node in self.cameras]
        for port, found, trouble in self.ports:
            what = "; ".join(each.what for each in found) or trouble or "nobody known answers"
            lines.append(f"serial port {port.path} ({port.description}): {what}")
        for host, found in self.hosts:
            what = "; ".join(each.what for each in found) or "nobody answers"
            lines.append(f"Modbus TCP {host}: {what}")
        return lines or ["no camera and no serial port"]

    def table(self) -> dict[str, Any]:
        """Return what was found as JSON."""
        return {
            "cameras": [vars(node) for node in self.cameras],
            "serial_ports": [
                {**vars(port), "found": [vars(each) for each in found], "trouble": trouble}
                for port, found, trouble in self.ports
            ],
            "modbus_tcp": [
                {"address": host, "found": [vars(each) for each in found]} for host, found in self.hosts
            ],
        }

    def rig_file(self) -> str:
        """Return a rig file with all that was found; what a person has to decide is left out, and named."""
        parts = [
            "# Made by `rig devices`. Fill in what is left open: `rig check` names what is missing.",
            '[rig]\nname = "my rig"',
        ]
        for number, node in enumerate(self.cameras):
            parts.append(
                _table(f"cameras.camera_{number}", "v4l2", {"device": node.path}, node.name, "camera")
            )
        used: set[str] = set()
        for each in self.found:
            table = _table(each.kind, each.driver, each.settings, each.what, each.kind)
            # a rig has one stage and one load frame: further ones are offered as comments
            parts.append(_commented(table) if each.kind in used or not each.driver else table)
            used.add(each.kind)
        parts.append('[operator]\ndriver = "console-operator"')
        return "\n\n".join(parts) + "\n"


def search(ports: list[str], hosts: list[str], *, ask: bool) -> Search:
    """Look what is there.

    Parameters
    ----------
    ports : list of str
        Serial ports besides those that the system lists.
    hosts : list of str
        Modbus TCP addresses, ``host`` or ``host:port``.
    ask : bool
        Whether serial ports are asked who is there. The questions change nothing, but a device that is none
        of those known gets bytes that it may not expect.
    """
    listed = [*serial_ports(), *(SerialPort(path, "named") for path in ports)]
    return Search(
        cameras=video_nodes(),
        ports=[(port, *(_asked(port) if ask else ([], "not asked"))) for port in listed],
        hosts=[(address, probe_modbus_tcp(address)) for address in map(_with_port, hosts)],
    )


def write_rig_file(found: Search, path: Path) -> None:
    """Write the rig file to start from; `RigError` if there is one already, or it cannot be written."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(found.rig_file())
    except OSError as error:
        raise RigError(
            str(path),
            expected="a new file that can be written",
            got=error.strerror or str(error),
            remedy="name another with -o",
        ) from error


def _asked(port: SerialPort) -> tuple[list[Found], str]:
    import termios

    if not os.access(port.path, os.R_OK | os.W_OK):
        return [], "cannot be opened: no permission, or not there"
    try:
        return probe_serial(port.path), ""
    except (OSError, termios.error) as error:
        return [], f"cannot be opened: {error}"


def _with_port(host: str) -> str:
    return host if host.rpartition(":")[2].isdecimal() and ":" in host else f"{host}:{MODBUS_PORT}"


def _table(name: str, driver: str, settings: dict[str, Any], what: str, kind: str) -> str:
    lines = [f"# {what}", f"[{name}]", f"driver = {json.dumps(driver)}"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in settings.items()]
    return "\n".join([*lines, f"# {_TO_DECIDE[kind]}"])


def _commented(text: str) -> str:
    return "\n".join(line if line.startswith("#") else f"# {line}" for line in text.split("\n"))
