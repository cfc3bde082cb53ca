"""What is plugged in, who answers, and a rig file to start from: the work of ``rig devices``."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.cameras.aravis.find import vision_cameras
from drivers.lines.channel import CHANNEL_ERRORS
from drivers.lines.serial_ports import FoundCamera, SerialPort, serial_ports, video_nodes
from drivers.probe import Found, probe_modbus_tcp, probe_serial
from drivers.settings import toml_table
from rig.errors import RigError

# `host`, `host:port`, and either behind `rtu://`; an IPv6 address stands in brackets
_MODBUS = re.compile(r"((?:rtu://)?(?:\[[^\[\]\s]+\]|[^:\s\[\]/]+))(?::(\d{1,5}))?")
MODBUS_PORT = 502

# What a person has to decide: without it the rig file is refused, and the message names each.
_TO_DECIDE = {
    "camera": "format, width_px, height_px, rate_hz, exposure_us: as the camera offers and the test needs",
    "stage": "angle_min_deg, angle_max_deg: how far the stage may turn",
    "load_frame": "load_max_n, displacement_max_mm: what the specimen and the machine may bear",
}

# What each driver of cameras calls the place of one.
_PLACE = {"v4l2": "device", "aravis": "camera"}


@dataclass
class Search:
    """What a search found.

    Attributes
    ----------
    cameras : list of FoundCamera
    no_vision : str
        Why cameras on networks and USB3 Vision were not looked for; empty if they were.
    ports : list of (SerialPort, list of Found, str)
        The last is why a port could not be asked; empty if it was, or should not be.
    hosts : list of (str, list of Found, str)
        Modbus addresses, likewise.
    """

    cameras: list[FoundCamera] = field(default_factory=list)
    no_vision: str = ""
    ports: list[tuple[SerialPort, list[Found], str]] = field(default_factory=list)
    hosts: list[tuple[str, list[Found], str]] = field(default_factory=list)

    @property
    def found(self) -> list[Found]:
        """Every device that answered."""
        lists = [found for _, found, _ in [*self.ports, *self.hosts]]
        return [each for found in lists for each in found]

    def lines(self) -> list[str]:
        """Return what was found, a line for each."""
        lines = [] if self.cameras else ["no camera"]
        lines += [f"camera {camera.place}: {camera.name or 'no name'}" for camera in self.cameras]
        if self.no_vision:
            lines.append(f"GigE Vision and USB3 Vision cameras: {self.no_vision}")
        for port, found, trouble in self.ports:
            what = "; ".join(each.what for each in found) or trouble or "nobody known answers"
            lines.append(f"serial port {port.path} ({port.description}): {what}")
        if not self.ports:
            lines.append("no serial port")
        for host, found, trouble in self.hosts:
            what = "; ".join(each.what for each in found) or trouble or "nobody answers"
            lines.append(f"Modbus at {host}: {what}")
        return lines

    def table(self) -> dict[str, Any]:
        """Return what was found as JSON."""
        return {
            "cameras": [vars(camera) for camera in self.cameras],
            "cameras_not_looked_for": self.no_vision,
            "serial_ports": [
                {**vars(port), "found": [vars(each) for each in found], "trouble": trouble}
                for port, found, trouble in self.ports
            ],
            "modbus": [
                {"address": host, "found": [vars(each) for each in found], "trouble": trouble}
                for host, found, trouble in self.hosts
            ],
        }

    def rig_file(self) -> str:
        """Return a rig file with all that was found; what a person has to decide is left out, and named."""
        parts = [
            "# Made by `rig devices`. Fill in what is left open: `rig check` names what is missing.",
            '[rig]\nname = "my rig"',
        ]
        for number, camera in enumerate(self.cameras):
            settings = {"driver": camera.driver, _PLACE[camera.driver]: camera.place}
            parts.append(_table(["cameras", f"camera_{number}"], settings, camera.name, "camera"))
        if not self.cameras:
            parts.append("# No camera was found: add [cameras.NAME] for each.")
        used: set[str] = set()
        for each in self.found:
            table = _table([each.kind], {"driver": each.driver, **each.settings}, each.what, each.kind)
            # a rig has one stage and one load frame: further ones are offered as comments
            if each.driver and each.kind not in used:
                parts.append(table)
                used.add(each.kind)
            else:
                parts.append(_commented(table))
        parts.append('[operator]\ndriver = "console-operator"')
        return "\n\n".join(parts) + "\n"


def search(ports: list[str], hosts: list[str], *, ask: bool) -> Search:
    """Look what is there.

    Parameters
    ----------
    ports : list of str
        Serial ports besides those that the system lists, and ``socket://host:port``.
    hosts : list of str
        Modbus addresses, ``host`` or ``host:port`` for Modbus TCP, ``rtu://host:port`` for RTU over TCP.
    ask : bool
        Whether anybody is asked who is there. The questions change nothing, but a device that is none
        of those known gets bytes that it may not expect.

    Raises
    ------
    RigError
        If a Modbus address is none; nobody is asked then.
    """
    addresses = [_with_port(host) for host in hosts]
    listed = {port.path: port for port in serial_ports()}
    listed |= {path: SerialPort(path, "named") for path in ports if path not in listed}
    vision, no_vision = _vision(ask)
    return Search(
        cameras=[*video_nodes(), *vision],
        no_vision=no_vision,
        ports=[(port, *_asked(probe_serial, path, ask)) for path, port in listed.items()],
        hosts=[(address, *_asked(probe_modbus_tcp, address, ask)) for address in addresses],
    )


def write_rig_file(found: Search, path: Path) -> None:
    """Write the rig file to start from; `RigError` if there is one already, or it cannot be written."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(found.rig_file())
    except OSError as error:
        raise RigError(
            str(path), "a new file that can be written", error.strerror or str(error), "name another with -o"
        ) from error


def _vision(ask: bool) -> tuple[list[FoundCamera], str]:
    if not ask:
        return [], "not asked"
    try:
        return vision_cameras(), ""
    except OSError as error:
        return [], f"not looked for without Aravis ({error}); apt install libaravis-0.8-0"


def _asked(probe: Callable[[str], list[Found]], place: str, ask: bool) -> tuple[list[Found], str]:
    if not ask:
        return [], "not asked"
    try:
        return probe(place), ""
    except CHANNEL_ERRORS as error:
        return [], f"cannot be opened: {error}"


def _with_port(address: str) -> str:
    match = _MODBUS.fullmatch(address)
    if match is None or int(match[2] or MODBUS_PORT) not in range(1, 2**16):
        raise RigError(
            "rig devices",
            "--modbus HOST[:PORT] or rtu://HOST[:PORT]",
            repr(address),
            "correct it, or name a serial port with --port",
        )
    return f"{match[1]}:{match[2] or MODBUS_PORT}"


def _table(names: list[str], settings: dict[str, Any], what: str, kind: str) -> str:
    # a comment must not end where a device's name has a line break
    said = "".join(sign if sign.isprintable() else " " for sign in what)
    return "\n".join([f"# {said}", toml_table(names, settings), f"# {_TO_DECIDE[kind]}"])


def _commented(text: str) -> str:
    return "\n".join(line if line.startswith("#") else f"# {line}" for line in text.split("\n"))
