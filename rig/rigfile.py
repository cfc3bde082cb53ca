"""The rig file: which drivers make up the rig, each with its own settings."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from drivers.errors import ConfigurationError
from drivers.registry import DeviceKind, DriverSpec, find_driver
from drivers.settings import Settings, mistakes_in, read_toml_text

_SINGLE: dict[str, DeviceKind] = {
    "simulation": "environment",
    "stage": "stage",
    "load_frame": "load_frame",
    "operator": "operator",
}


@dataclass(frozen=True)
class DeviceEntry:
    """One device of the rig file: its name there, its driver, and the settings the driver accepted."""

    name: str
    driver: str
    spec: DriverSpec
    settings: Settings

    def setting(self, name: str) -> Any:
        """Return a setting that many drivers have, such as ``load_max_n``; None if this driver lacks it."""
        return getattr(self.settings, name, None)


@dataclass(frozen=True)
class RigFile:
    """A rig file without mistakes.

    Attributes
    ----------
    path : Path
    text : str
        The text of the file, which the run file records.
    name : str
    simulated : bool
        Whether the file declares a device simulated; the device's driver cannot know it.
    operator : DeviceEntry
    cameras : dict of str to DeviceEntry
        In the order of the file.
    simulation, stage, load_frame : DeviceEntry or None
    """

    path: Path
    text: str
    name: str
    simulated: bool
    operator: DeviceEntry
    cameras: dict[str, DeviceEntry]
    simulation: DeviceEntry | None
    stage: DeviceEntry | None
    load_frame: DeviceEntry | None


class _RigTable(Settings):
    name: str = Field(min_length=1, max_length=200)
    simulated: bool = Field(default=False, strict=True)


def read_rig(path: str | Path) -> RigFile:
    """Read a rig file; nothing is opened.

    Raises
    ------
    ConfigurationError
        If the file cannot be read or has mistakes; the message lists those of all tables.
    """
    path = Path(path)
    data, text = read_toml_text(path)
    known = ", ".join(sorted(_KNOWN))
    mistakes = [
        f"{key}: unknown key; remove it, or name it one of {known}" for key in data if key not in _KNOWN
    ]
    rig = _read_rig_table(data.get("rig"), mistakes)
    devices = {
        key: _read_device(key, data[key], kind, mistakes) for key, kind in _SINGLE.items() if key in data
    }
    cameras = _read_cameras(data.get("cameras"), mistakes)
    operator = devices.get("operator")
    if "operator" not in data:
        mistakes.append('operator: is missing; add it, such as [operator] with driver = "console-operator"')
    if mistakes or rig is None or operator is None:
        raise ConfigurationError(str(path), mistakes)
    return RigFile(
        path=path,
        text=text,
        name=rig.name,
        simulated=rig.simulated,
        operator=operator,
        cameras=cameras,
        simulation=devices.get("simulation"),
        stage=devices.get("stage"),
        load_frame=devices.get("load_frame"),
    )


_KNOWN = {"rig", "cameras", *_SINGLE}


def _read_rig_table(table: object, mistakes: list[str]) -> _RigTable | None:
    try:
        return _RigTable.model_validate({} if table is None else table)
    except ValidationError as error:
        mistakes += mistakes_in(error, "rig")
        return None


def _read_cameras(table: object, mistakes: list[str]) -> dict[str, DeviceEntry]:
    if not isinstance(table, dict) or not table:
        mistakes.append("cameras: at least one table [cameras.NAME] is expected; add it")
        return {}
    cameras = {}
    for name, settings in table.items():
        if not name.isidentifier():
            mistakes.append(f"cameras.{name}: a name of letters, digits and _ is expected, such as off_axis")
        if name in ("stage", "load_frame"):
            # The run file stores all devices in one group, by name.
            mistakes.append(
                f"cameras.{name}: a name other than stage and load_frame is expected, such as off_axis"
            )
        entry = _read_device(f"cameras.{name}", settings, "camera", mistakes)
        if entry is not None:
            cameras[name] = entry
    return cameras


def _read_device(where: str, table: object, kind: DeviceKind, mistakes: list[str]) -> DeviceEntry | None:
    """Check one table against its driver's settings; append each mistake to `mistakes`."""
    if not isinstance(table, dict) or not isinstance(table.get("driver"), str):
        mistakes.append(f'{where}: a table with driver = "NAME" is expected; add the driver')
        return None
    driver = table["driver"]
    try:
        spec = find_driver(driver)
    except LookupError as error:
        mistakes.append(f"{where}.driver: {error}")
        return None
    if spec.kind != kind:
        mistakes.append(
            f"{where}.driver: a driver of kind {kind} is expected, {driver!r} is one of kind {spec.kind}; "
            f"name a driver of kind {kind}"
        )
        return None
    try:
        settings = spec.settings.model_validate(
            {key: value for key, value in table.items() if key != "driver"}
        )
    except ValidationError as error:
        mistakes += mistakes_in(error, where)
        return None
    return DeviceEntry(where, driver, spec, settings)
