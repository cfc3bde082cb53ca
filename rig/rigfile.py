"""Read the rig file, which gives the driver and the settings of each device."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias, TypeVar

from pydantic import Field, ValidationError, model_validator

from drivers.errors import ConfigurationError
from drivers.registry import DeviceKind, DriverSpec, find_driver
from drivers.settings import Settings, mistakes_in, read_toml_text
from drivers.signals import Signal
from rig.camera_line import camera_of_line, mistakes_of_shared_lines
from rig.guarding import GuardianSettings
from rig.limit_settings import RigLimits
from rig.measured_load import MeasuredLoad
from rig.mounting import Mounting
from rig.notifying import NewsSettings
from rig.recording import RecordingSettings

TriggerEvent: TypeAlias = Literal["exposure", "start", "step", "end"]
"""When an output line gives a pulse: at each image, when images begin, when a step is on file, at its end."""

_Table = TypeVar("_Table", bound=Settings)

_SINGLE: dict[str, DeviceKind] = {
    "simulation": "environment",
    "stage": "stage",
    "load_frame": "load_frame",
    "operator": "operator",
}


CALL_TIMEOUT_S = 0.7
"""Default deadline of a device's call in s. If a call hangs, the machine still stops within 1 s."""


@dataclass(frozen=True)
class DeviceEntry:
    """One device of the rig file: its name, its driver, and the settings that the driver accepted."""

    name: str
    driver: str
    spec: DriverSpec
    settings: Settings

    def setting(self, name: str) -> Any:
        """Return the value of a setting such as ``load_max_n``, or None if the driver has no such setting."""
        return getattr(self.settings, name, None)


@dataclass(frozen=True)
class InterlockEntry:
    """An interlock in the rig file: the device, and the range of its value in which a run may continue."""

    device: DeviceEntry
    allowed_min: float | None
    allowed_max: float | None


@dataclass(frozen=True)
class TriggerEntry:
    """An output line in the rig file: the device, and the event of a run at which it gives a pulse.

    `device` is None if the line belongs to the camera of the rig that is called `camera`.
    """

    device: DeviceEntry | None
    at: TriggerEvent
    camera: str = ""


@dataclass(frozen=True)
class RigFile:
    """The checked content of a rig file.

    Attributes
    ----------
    path : Path
    text : str
        The text of the file. The run file stores a copy of this text.
    name : str
    simulated : bool
        True if the rig file declares that the rig is simulated. A driver cannot always detect a simulated
        device.
    operator : DeviceEntry
    cameras : dict of str to DeviceEntry
        The cameras in the order of the file.
    simulation, stage, load_frame : DeviceEntry or None
        None if the file has no such table.
    call_timeout_s : float
        Deadline of one call of the load frame or the stage.
    recording : RecordingSettings
    guardian : GuardianSettings
    limits : RigLimits
    interlocks : dict of str to InterlockEntry
    news : NewsSettings
    mounting : Mounting
    channels : dict of str to DeviceEntry
        The channel devices in the order of the file.
    measured_load : MeasuredLoad or None
        The signals of a load frame that is only read. Then `load_frame` is None.
    triggers : dict of str to TriggerEntry
        The output lines.
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
    recording: RecordingSettings = field(default_factory=RecordingSettings)
    call_timeout_s: float = CALL_TIMEOUT_S
    guardian: GuardianSettings = field(default_factory=GuardianSettings)
    limits: RigLimits = field(default_factory=RigLimits)
    interlocks: dict[str, "InterlockEntry"] = field(default_factory=dict)
    news: NewsSettings = field(default_factory=NewsSettings)
    mounting: Mounting = field(default_factory=Mounting)
    channels: dict[str, DeviceEntry] = field(default_factory=dict)
    measured_load: MeasuredLoad | None = None
    triggers: dict[str, TriggerEntry] = field(default_factory=dict)

    @property
    def signals(self) -> dict[str, Signal]:
        """All signals of the rig, by their names."""
        return _signals(self.channels)


class _RigTable(Settings):
    name: str = Field(min_length=1, max_length=200)
    simulated: bool = Field(default=False, strict=True)
    call_timeout_s: float = Field(default=CALL_TIMEOUT_S, ge=0.05, le=60.0)


def read_rig(path: str | Path) -> RigFile:
    """Read and check a rig file without opening any device.

    Raises
    ------
    ConfigurationError
        If the file cannot be read or has mistakes. The message lists the mistakes in all tables.
    """
    path = Path(path)
    data, text = read_toml_text(path)
    if "kind" in data and not _KNOWN & set(data):
        raise ConfigurationError(str(path), ["expected a rig file, got a protocol; give the rig file here"])
    known = ", ".join(sorted(_KNOWN))
    mistakes = [
        f"{key}: unknown key; remove it, or name it one of {known}" for key in data if key not in _KNOWN
    ]
    rig = _read_table("rig", _RigTable, data, mistakes)
    recording = _read_table("recording", RecordingSettings, data, mistakes)
    guardian = _read_table("guardian", GuardianSettings, data, mistakes)
    limits = _read_table("limits", RigLimits, data, mistakes)
    news = _read_table("news", NewsSettings, data, mistakes)
    mounting = _read_table("mounting", Mounting, data, mistakes)
    measured = None
    tables = dict(data)
    if isinstance(frame := data.get("load_frame"), dict) and "driver" not in frame and "load" in frame:
        measured = _read_table("load_frame", MeasuredLoad, data, mistakes)
        del tables["load_frame"]
    devices = {
        key: _read_device(key, tables[key], kind, mistakes) for key, kind in _SINGLE.items() if key in tables
    }
    channels = _read_named("channels", "channels", data.get("channels", {}), mistakes)
    mistakes += _mistakes_of_signals(channels)
    if measured is not None:
        mistakes += measured.mistakes(_signals(channels))
    cameras = _read_cameras(data.get("cameras"), mistakes)
    interlocks = _read_interlocks(data.get("interlocks", {}), mistakes)
    triggers = _read_triggers(data.get("triggers", {}), cameras, mistakes)
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
        recording=recording or RecordingSettings(),
        call_timeout_s=rig.call_timeout_s,
        guardian=guardian or GuardianSettings(),
        limits=limits or RigLimits(),
        interlocks=interlocks,
        news=news or NewsSettings(),
        mounting=mounting or Mounting(),
        channels=channels,
        measured_load=measured,
        triggers=triggers,
    )


_TABLES = ("cameras", "channels", "triggers", "interlocks")
_KNOWN = {"rig", "limits", "recording", "guardian", "news", "mounting", *_TABLES, *_SINGLE}


def _read_table(key: str, settings: type[_Table], data: dict[str, Any], mistakes: list[str]) -> _Table | None:
    """Check an optional table of the file. Append each mistake to `mistakes`."""
    try:
        return settings.model_validate(data.get(key, {}))
    except ValidationError as error:
        mistakes += mistakes_in(error, key)
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
            # All devices are in one group of the run file, so a camera must not have the name of another
            # device.
            mistakes.append(
                f"cameras.{name}: a name other than stage and load_frame is expected, such as off_axis"
            )
        entry = _read_device(f"cameras.{name}", settings, "camera", mistakes)
        if entry is not None:
            cameras[name] = entry
    return cameras


class _Allowed(Settings):
    allowed_min: float | None = None
    allowed_max: float | None = None

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        low, high = self.allowed_min, self.allowed_max
        if low is None and high is None:
            raise ValueError("allowed_min or allowed_max is expected, such as allowed_min = 1 for a contact")
        if low is not None and high is not None and low > high:
            raise ValueError(f"allowed_min must be at most allowed_max, {high:g}, got {low:g}")
        return self


def _read_interlocks(tables: object, mistakes: list[str]) -> dict[str, InterlockEntry]:
    if not isinstance(tables, dict):
        mistakes.append("interlocks: tables [interlocks.NAME] are expected; correct them")
        return {}
    interlocks = {}
    for name, table in tables.items():
        where = f"interlocks.{name}"
        if not name.isidentifier():
            mistakes.append(f"{where}: a name of letters, digits and _ is expected, such as door")
        if not isinstance(table, dict):
            mistakes.append(f'{where}: a table with driver = "NAME" is expected; add the driver')
            continue
        bounds = {key: float(value) if type(value) is int else value for key, value in table.items()}
        try:
            allowed = _Allowed.model_validate(
                {key: bounds[key] for key in ("allowed_min", "allowed_max") if key in bounds}
            )
        except ValidationError as error:
            mistakes += mistakes_in(error, where)
            continue
        settings = {key: value for key, value in table.items() if not key.startswith("allowed_")}
        entry = _read_device(where, settings, "interlock", mistakes)
        if entry is not None:
            interlocks[name] = InterlockEntry(entry, allowed.allowed_min, allowed.allowed_max)
    return interlocks


class _At(Settings):
    at: TriggerEvent = Field(default="exposure", description="when a pulse is given")


def _read_triggers(
    tables: object, cameras: Mapping[str, DeviceEntry], mistakes: list[str]
) -> dict[str, TriggerEntry]:
    events: dict[str, TriggerEvent] = {}
    devices: dict[str, dict[str, Any]] = {}
    lines: dict[str, dict[str, Any]] = {}
    for name, table in tables.items() if isinstance(tables, dict) else ():
        if not isinstance(table, dict):
            continue
        try:
            events[name] = _At.model_validate({key: table[key] for key in ("at",) if key in table}).at
        except ValidationError as error:
            mistakes += mistakes_in(error, f"triggers.{name}")
        rest = {key: value for key, value in table.items() if key != "at"}
        (lines if "camera" in rest and "driver" not in rest else devices)[name] = rest
    found = _read_named("triggers", "trigger", devices if isinstance(tables, dict) else tables, mistakes)
    entries = {name: TriggerEntry(entry, events[name]) for name, entry in found.items() if name in events}
    for name, table in lines.items():
        camera = camera_of_line(f"triggers.{name}", table, cameras, mistakes)
        if camera and name in events:
            entries[name] = TriggerEntry(None, events[name], camera)
    mistakes += mistakes_of_shared_lines([entry.camera for entry in entries.values() if entry.camera])
    return entries


def _read_named(group: str, kind: DeviceKind, tables: object, mistakes: list[str]) -> dict[str, DeviceEntry]:
    """Read the tables `[group.NAME]` of devices of one kind."""
    if not isinstance(tables, dict):
        mistakes.append(f"{group}: tables [{group}.NAME] are expected; correct them")
        return {}
    found = {}
    for name, table in tables.items():
        where = f"{group}.{name}"
        if not name.isidentifier():
            mistakes.append(f"{where}: a name of letters, digits and _ is expected, such as box")
        entry = _read_device(where, table, kind, mistakes)
        if entry is not None:
            found[name] = entry
    return found


def _signals(channels: Mapping[str, DeviceEntry]) -> dict[str, Signal]:
    return {signal.name: signal for entry in channels.values() for signal in entry.setting("declared") or ()}


def _mistakes_of_signals(channels: Mapping[str, DeviceEntry]) -> list[str]:
    """Return one sentence for each name that two signals have."""
    names = [signal.name for entry in channels.values() for signal in entry.setting("declared") or ()]
    return [
        f"channels: a name of its own is expected for each signal, {name!r} is used {count} times"
        for name, count in Counter(names).items()
        if count > 1
    ]


def _read_device(where: str, table: object, kind: DeviceKind, mistakes: list[str]) -> DeviceEntry | None:
    """Check one table of the rig file against the settings of its driver. Append mistakes to `mistakes`."""
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
