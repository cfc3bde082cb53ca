"""Check the rig file of a simulation, and write a rig file with the simulation's addresses."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import ValidationError

from drivers.clock import SystemClock
from drivers.errors import ConfigurationError
from drivers.settings import Settings, mistakes_in, toml_table
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.operator import OperatorSettings
from simulators.rig.places import served
from simulators.rig.virtual_rig import VirtualRigSettings

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
    "operator": {"driver": "simulated-operator", "duration_s": 1.0},
}
_ON_WIRES = ("stage", "load_frame")
_GROUPS_ON_WIRES = ("channels", "triggers")

S = TypeVar("S", bound=Settings)


@dataclass(frozen=True)
class RigTables:
    """The content of a rig file in which all devices are simulated."""

    content: Mapping[str, Any]  # the tables of the rig file, unchanged
    simulation: VirtualRigSettings
    cameras: dict[str, CameraSettings]
    operator: OperatorSettings

    @classmethod
    def read(cls, content: Mapping[str, Any], source: str) -> "RigTables":
        """Check the content of a rig file; for empty content, use `DEFAULTS`.

        A real device is refused, because a user of the simulation could move the device by mistake. Raise
        `ConfigurationError` if the content has mistakes. The message lists all mistakes.
        """
        content = content or DEFAULTS
        mistakes: list[str] = []

        def settings(where: str, table: object, driver: str, model: type[S]) -> S:
            if not isinstance(table, Mapping) or table.get("driver") != driver:
                mistakes.append(f'{where}: a table with driver = "{driver}" is expected; correct it')
                return model()
            try:
                return model.model_validate({key: value for key, value in table.items() if key != "driver"})
            except ValidationError as error:
                mistakes.extend(mistakes_in(error, where))
                return model()

        simulation, operator = (content.get(name, DEFAULTS[name]) for name in ("simulation", "operator"))
        cameras = content.get("cameras", {})
        if not isinstance(cameras, Mapping):
            mistakes.append("cameras: tables [cameras.NAME] are expected; correct them")
            cameras = {}
        read = cls(
            content,
            settings("simulation", simulation, "virtual-rig", VirtualRigSettings),
            {
                name: settings(f"cameras.{name}", table, "simulated-camera", CameraSettings)
                for name, table in cameras.items()
            },
            settings("operator", operator, "simulated-operator", OperatorSettings),
        )
        servers = served(closed_machine=read.simulation.closed_machine is not None)
        for name in _ON_WIRES:
            mistakes += _unreachable(name, content.get(name), servers)
        for group in _GROUPS_ON_WIRES:
            tables = content.get(group, {})
            if not isinstance(tables, Mapping):
                mistakes.append(f"{group}: tables [{group}.NAME] are expected; correct them")
                continue
            for name, table in tables.items():
                mistakes += _unreachable(f"{group}.{name}", table, servers)
        if mistakes:
            raise ConfigurationError(source, mistakes)
        return read

    def rig_file(self, addresses: Mapping[str, str]) -> str:
        """Return a rig file with which another program uses the simulation at these addresses."""
        scene = addresses["scene"]
        parts = [
            f"# Devices of a simulation that was started on {SystemClock().utc():%Y-%m-%d %H:%M} UTC.",
            # A driver cannot detect from the protocol that its device is simulated.
            toml_table(["rig"], {**self.content.get("rig", DEFAULTS["rig"]), "simulated": True}),
        ]
        parts += [
            toml_table([name], _reached(self.content[name], addresses))
            for name in _ON_WIRES
            if name in self.content
        ]
        for group in _GROUPS_ON_WIRES:
            for name, table in self.content.get(group, {}).items():
                parts.append(toml_table([group, name], _reached(table, addresses)))
        for name in self.cameras:
            camera = {"driver": "remote-camera", "address": scene, "camera": name}
            parts.append(toml_table(["cameras", name], camera))
        operator = {
            "driver": "remote-operator",
            "address": scene,
            "duration_s": self.operator.duration_s,
        }
        parts.append(toml_table(["operator"], operator))
        return "\n\n".join(parts) + "\n"


def _reached(table: Mapping[str, Any], addresses: Mapping[str, str]) -> dict[str, Any]:
    """Return the table of a device with the addresses of its servers."""
    return {key: addresses[value[1:]] if _is_name(value) else value for key, value in table.items()}


def _unreachable(name: str, table: object, servers: Collection[str]) -> list[str]:
    """Return a message if the rig file gives a device an address that the simulation does not have."""
    if table is None:
        return []
    if isinstance(table, Mapping) and "load" in table and "driver" not in table:
        return []  # a load frame that channels read
    named = [value for value in table.values() if _is_name(value)] if isinstance(table, Mapping) else []
    if not named:
        return [f'{name}: the address of a simulated device is expected, such as "@{name}"; correct it']
    return [
        f"{name}: {each!r} is none of the simulation's servers: {', '.join(f'@{known}' for known in servers)}"
        for each in named
        if each[1:] not in servers
    ]


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value.startswith("@")
