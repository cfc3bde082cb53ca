"""Data about a run that are known before it begins: protocol, rig file, versions, computer, devices."""

import hashlib
import json
import math
import os
import platform
import shlex
import sys
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from importlib.metadata import version
from typing import Any

import h5py

from drivers.interfaces import DeviceInfo
from rig.device_settings import reports_settings
from rig.devices import Rig
from rig.protocol.protocol import Protocol
from rig.recorder.records import ChannelsRecord, InterlockRecord, RunHeader, SignalRecord
from rig.rigfile import DeviceEntry, RigFile

_PACKAGES = ("offaxis", "numpy", "h5py", "pydantic")


def make_header(
    protocol: Protocol, definition: str, rig_file: RigFile, rig: Rig, continues: str = ""
) -> RunHeader:
    """Collect the data about a run on an opened rig. `definition` is the text of the protocol file."""
    start = rig.clock.utc()
    digest = hashlib.sha256((definition + rig_file.text).encode()).hexdigest()
    return RunHeader(
        title=protocol.title,
        run_id=f"{start:%Y%m%dT%H%M%SZ}-{digest[:8]}",
        definition=definition,
        configuration=rig_file.text,
        start=start,
        versions=_versions(),
        sample=protocol.sample,
        grid=protocol.grid,
        simulated=rig.simulated,
        provenance=_json(_provenance()),
        continues=continues,
        devices=_devices(rig_file, rig),
        mounting=protocol.mounting.over(rig_file.mounting),
    )


def interlock_records(rig: Rig) -> dict[str, InterlockRecord]:
    """Return the interlocks of an opened rig as the run file describes them."""
    records = {}
    for name, each in rig.interlocks.items():
        identity = {known.name: getattr(each.device.info, known.name) for known in fields(DeviceInfo)}
        records[name] = InterlockRecord(
            **identity,
            unit=each.device.unit,
            allowed_min=-math.inf if each.allowed_min is None else each.allowed_min,
            allowed_max=math.inf if each.allowed_max is None else each.allowed_max,
        )
    return records


def channel_records(rig: Rig) -> dict[str, ChannelsRecord]:
    """Return the channel devices of an opened rig as the run file describes them."""
    quantities = {name: quantity for quantity, name in rig.measured.items()}
    return {
        name: ChannelsRecord(
            device.info,
            tuple(SignalRecord(signal, quantities.get(signal.name, "")) for signal in device.signals),
        )
        for name, device in rig.channels.items()
    }


def _devices(rig_file: RigFile, rig: Rig) -> dict[str, str]:
    opened: dict[str, tuple[DeviceEntry | None, Any]] = {
        name: (rig_file.cameras.get(name), camera) for name, camera in rig.cameras.items()
    }
    if rig.stage is not None:
        opened["stage"] = rig_file.stage, rig.stage
    if rig.load_frame is not None:
        opened["load_frame"] = rig_file.load_frame, rig.load_frame
    for name, interlock in rig.interlocks.items():
        entry = rig_file.interlocks.get(name)
        opened[f"interlocks.{name}"] = None if entry is None else entry.device, interlock.device
    for name, device in rig.channels.items():
        opened[f"channels.{name}"] = rig_file.channels.get(name), device
    return {name: _json(_device(*found)) for name, found in opened.items()}


def _device(entry: DeviceEntry | None, device: Any) -> dict[str, Any]:
    """Return a device's driver, its settings from the rig file, and whether its driver reports settings."""
    return {
        "driver": "" if entry is None else entry.driver,
        "asked": {} if entry is None else entry.settings.model_dump(mode="json"),
        "reports_settings": reports_settings(device),
    }


def _provenance() -> dict[str, Any]:
    return {
        "command": shlex.join(sys.argv),
        "folder": os.getcwd(),  # noqa: PTH109
        "host": platform.node(),
        "system": platform.platform(),
        "processors": os.cpu_count(),
        "process": os.getpid(),
    }


@cache
def _versions() -> str:
    packages = {name: version(name) for name in _PACKAGES}
    programs = {"python": platform.python_version(), "hdf5": h5py.version.hdf5_version}
    return "\n".join(f"{name} {number}" for name, number in (packages | programs).items())


def _json(table: Mapping[str, Any]) -> str:
    return json.dumps(table, ensure_ascii=False, default=str, indent=1)
