"""The virtual rig as servers for other programs, in real time: what `rig simulate` runs."""

import json
import threading
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.clock import SystemClock
from drivers.errors import ConfigurationError
from drivers.interfaces import OpenContext
from drivers.settings import validate
from simulators.camera import SPEC as CAMERA_SPEC
from simulators.camera import CameraSettings
from simulators.faults import FAULTS
from simulators.operator import SimulatedOperator
from simulators.scene_wire import SceneServer
from simulators.truth_log import TruthLog
from simulators.virtual_rig import VirtualRig, VirtualRigSettings

DEFAULTS: dict[str, Any] = {
    "rig": {"name": "simulated rig"},
    "simulation": {"driver": "virtual-rig"},
    "stage": {
        "driver": "zaber-ascii",
        "port": "@stage",
        "angle_min_deg": -5.0,
        "angle_max_deg": 365.0,
    },
    "load_frame": {
        "driver": "modbus-frame",
        "address": "@load_frame",
        "load_max_n": 14_000.0,
        "displacement_max_mm": 6.0,
    },
    "cameras": {
        "on_axis": {"driver": "simulated-camera"},
        "off_axis": {"driver": "simulated-camera", "tilt_deg": 30.0},
    },
}
OPERATOR_S = 1.0
HELP = (
    "fault DEVICE.FAULT   switch a fault on, such as stage.drop:2",
    "clear [DEVICE[.FAULT]]   switch it off, or all of them",
    "faults   which are on",
    "truth   what is true now",
    "quit   or Ctrl-C",
)


class StoppableClock(SystemClock):
    """The machine's own time, whose sleepers wake when the simulation ends."""

    def __init__(self) -> None:
        self._stopped = threading.Event()

    def sleep(self, duration_s: float) -> None:
        """Block for `duration_s` seconds, or until the end."""
        self._stopped.wait(max(0.0, duration_s))

    def stop(self) -> None:
        """Wake everybody who sleeps."""
        self._stopped.set()


class Simulation:
    """Every server of a virtual rig, its cameras and its operator, and a log of what is true.

    Parameters
    ----------
    tables : mapping
        A rig file's content; what it has not got is taken from `DEFAULTS`, unless it has any devices.
    source : str
        The rig file, for messages.
    log : Path or None
        Where the truth is written.

    Raises
    ------
    ConfigurationError
        If the tables have mistakes.
    OSError
        If the log cannot be written.
    """

    def __init__(self, tables: Mapping[str, Any], source: str, log: Path | None) -> None:
        self._tables = {**DEFAULTS, **tables} if not tables else dict(tables)
        cameras = _camera_settings(self._tables, source)
        self._clock = StoppableClock()
        settings = _without_driver(self._tables.get("simulation", {}))
        self.rig = VirtualRig(validate(VirtualRigSettings, settings, source), self._clock)
        try:
            self.log = TruthLog(log, self.rig)
        except OSError:
            self.rig.close()
            raise
        self._scene = SceneServer(
            {
                name: CAMERA_SPEC.open(each, OpenContext(f"cameras.{name}", self._clock, self.rig))
                for name, each in cameras.items()
            },
            SimulatedOperator(self.rig.scene, self._clock, OPERATOR_S),
            self.log.frame,
        )
        self._cameras = list(cameras)

    @property
    def addresses(self) -> dict[str, str]:
        """Where each server is; ``scene`` is that of the cameras and the operator."""
        return {**self.rig.addresses, "scene": self._scene.address}

    def rig_file(self) -> str:
        """Return a rig file that uses this simulation from another program."""
        scene = self._scene.address
        parts = [
            f"# Devices of a simulation that was started on {datetime.now(UTC):%Y-%m-%d %H:%M} UTC.",
            _toml("rig", self._tables.get("rig", DEFAULTS["rig"])),
        ]
        parts += [_toml(name, self._reachable(self._tables[name])) for name in self._devices()]
        parts += [
            _toml(f"cameras.{name}", {"driver": "remote-camera", "address": scene, "camera": name})
            for name in self._cameras
        ]
        parts.append(_toml("operator", {"driver": "remote-operator", "address": scene}))
        return "\n\n".join(parts) + "\n"

    def command(self, line: str) -> list[str]:
        """Carry out a line of the operator's and return what to print."""
        verb, _, rest = line.strip().partition(" ")
        faults = self.rig.faults
        try:
            match verb:
                case "fault":
                    self.switch_on(rest)
                case "clear":
                    faults.clear(rest)
                    self.log.write("fault", fault=rest.strip(), on=False)
                case "truth":
                    return [f"{name}: {value:.6g}" for name, value in self.rig.truth().items()]
                case "faults":
                    pass
                case _:
                    return list(HELP)
        except ValueError as error:
            return [str(error)]
        return [f"on: {', '.join(faults.active) or 'nothing'}"]

    def switch_on(self, fault: str) -> None:
        """Switch a fault on; ValueError says what is wrong with its name."""
        self.rig.faults.switch_on(fault)
        self.log.write("fault", fault=fault.strip(), on=True)

    @staticmethod
    def list_faults() -> list[str]:
        """Return a line for each fault: how it is written, which devices can have it, what it does."""
        width = max(len(fault.usage) for fault in FAULTS.values())
        return [
            f"{fault.usage:{width}}  {fault.summary} ({', '.join(fault.devices)})"
            for fault in FAULTS.values()
        ]

    def close(self) -> None:
        """Stop every server; harmless when repeated."""
        self._clock.stop()
        self._scene.close()
        self.rig.close()
        self.log.close()

    def _devices(self) -> list[str]:
        return [name for name in ("stage", "load_frame") if name in self._tables]

    def _reachable(self, table: Mapping[str, Any]) -> dict[str, Any]:
        """Put addresses in the place of their names."""
        found = {
            key: self.rig.addresses.get(value[1:], value)
            if isinstance(value, str) and value.startswith("@")
            else value
            for key, value in table.items()
        }
        if str(found.get("address", "")).startswith("/"):
            found["parity"] = "N"  # a pseudo-terminal carries no parity bits
        return found


def _camera_settings(tables: Mapping[str, Any], source: str) -> dict[str, CameraSettings]:
    cameras = tables.get("cameras", {})
    if not isinstance(cameras, Mapping) or not all(isinstance(each, Mapping) for each in cameras.values()):
        raise ConfigurationError(source, ["cameras: tables [cameras.NAME] are expected; correct them"])
    return {
        name: validate(CameraSettings, _without_driver(table), f"{source}, cameras.{name}")
        for name, table in cameras.items()
        if table.get("driver") == "simulated-camera"
    }


def _without_driver(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key != "driver"}


def _toml(name: str, table: Mapping[str, Any]) -> str:
    """Return a table of texts, numbers and truth values."""
    # JSON writes all three as TOML does
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in table.items()]
    return "\n".join([f"[{name}]", *lines])
