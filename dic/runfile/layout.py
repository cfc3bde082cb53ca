"""Compare an open run file with the layout in `dic.runfile.schema`, before any value is used."""

import json
from typing import Any

import numpy as np

from dic.runfile import schema

_DEVICES = {"stage": schema.STAGE, "load_frame": schema.LOAD_FRAME}


class Unlike(ValueError):
    """A run file does not have the layout of run files. The message names the difference."""


def camera_names(file: Any) -> list[str]:
    """Return the names of the cameras in an open run file."""
    instrument = _group(file, "entry/instrument")
    names = [name for name in instrument if name not in _DEVICES]
    for name in names:
        # The names of cameras become names of files and of columns.
        if not name.isidentifier():
            raise Unlike(f"a camera with the name {name!r}")
    if not names:
        raise Unlike("no camera")
    return names


def interlock_names(file: Any) -> list[str]:
    """Return the names of the interlocks in an open run file; files of earlier versions have none."""
    return _names(file, schema.INTERLOCKS_GROUP, "an interlock")


def channel_names(file: Any) -> list[str]:
    """Return the names of the channel devices in an open run file; files of earlier versions have none."""
    return _names(file, schema.CHANNELS_GROUP, "a channel device")


def _names(file: Any, folder: str, what: str) -> list[str]:
    entry = _group(file, "entry")
    if folder not in entry:
        return []
    names = list(_group(entry, folder))
    for name in names:
        if not name.isidentifier():
            raise Unlike(f"{what} with the name {name!r}")
    return names


def require_layout(file: Any) -> None:
    """Check all types, dimensions and lengths of a run file.

    Raises `Unlike` if a group or data set is missing or of another type. The message names the first such
    group or data set.
    """
    entry = _group(file, "entry")
    groups = {"": schema.ENTRY, "sample": schema.SAMPLE, "grid": schema.GRID}
    if schema.MOUNTING_GROUP in entry:
        groups[schema.MOUNTING_GROUP] = schema.MOUNTING
    for name, layout in groups.items():
        group = _group(entry, name) if name else entry
        for item in layout.items:
            _require_item(group, item, (2,) if item.name in ("lines", "tilt_axis_mm") else ())
    cameras = camera_names(file)
    for name in cameras:
        camera = _group(file, f"entry/instrument/{name}")
        frames = _table(camera, schema.DETECTOR)
        pixels = _dataset(camera, schema.PIXELS)
        if pixels.rank != 3 or pixels.dtype not in (np.uint8, np.uint16) or 0 in pixels.shape[1:]:
            raise Unlike(f"images of {name} as {pixels.dtype} {pixels.shape}")
        if pixels.shape[0] < frames:
            raise Unlike(f"{pixels.shape[0]} images of {name} for {frames} rows")
    for name, layout in _DEVICES.items():
        if name in file["entry/instrument"]:
            _table(_group(file, f"entry/instrument/{name}"), layout)
    for name in interlock_names(file):
        group = _group(file, f"entry/{schema.INTERLOCKS_GROUP}/{name}")
        _table(group, schema.INTERLOCK)
        missing = [attribute for attribute in schema.INTERLOCK.attributes if attribute not in group.attrs]
        if missing:
            raise Unlike(f"the interlock {name} without {missing[0]}")
    for name in channel_names(file):
        group = _group(file, f"entry/{schema.CHANNELS_GROUP}/{name}")
        _table(group, schema.channels(signals_of(group)))
    _table(_group(file, "entry/steps"), schema.steps(cameras))
    _table(_group(file, "entry/events"), schema.EVENTS)
    if schema.REPORTED_GROUP in entry:
        _table(_group(entry, schema.REPORTED_GROUP), schema.REPORTED)


def signals_of(group: Any) -> dict[str, Any]:
    """Return what the group of a channel device says about its signals, by their names."""
    dataset = _require_item(group, schema.SIGNALS, ())
    found = json.loads(bytes(group[schema.SIGNALS.name][()]).rstrip(b"\0")) if dataset is not None else None
    if not isinstance(found, dict) or not found:
        raise Unlike(f"{group.name} without a signal")
    for name in found:
        # The names of signals become names of columns. Those of live gauges have dots.
        if not all(part.isidentifier() for part in name.split(".")):
            raise Unlike(f"a signal with the name {name!r}")
    return found


def _table(group: Any, layout: schema.GroupLayout) -> int:
    """Check the columns of a table, and return the number of its complete rows."""
    found = {item.name: _require_item(group, item, None) for item in layout.items}
    lengths = {name: dataset.shape[0] for name, dataset in found.items() if dataset is not None}
    # In the file of a killed run, other columns may be longer than the last column, which is written last.
    rows: int = lengths[layout.items[-1].name]
    for name, length in lengths.items():
        if length < rows:
            raise Unlike(f"{length} rows of {group.name}/{name} instead of {rows}")
    return rows


def _require_item(group: Any, item: schema.Item, shape: tuple[int, ...] | None) -> Any | None:
    """Check a data set, and return it; return None if it is missing from a file of an earlier version."""
    if item in schema.LATER and item.name not in group:
        return None
    dataset = _dataset(group, item.name)
    dtype = dataset.dtype
    if item.text_bytes is None:
        alike = dtype == np.dtype(item.dtype)
    else:
        alike = dtype.kind == "S" and item.text_bytes in (0, dtype.itemsize)
    if not alike:
        raise Unlike(f"{group.name}/{item.name} as {dtype}")
    if dataset.rank != 1 if shape is None else dataset.shape != shape:
        raise Unlike(f"{group.name}/{item.name} of shape {dataset.shape}")
    return dataset


def _group(parent: Any, name: str) -> Any:
    import h5py

    found = parent.get(name)
    if not isinstance(found, h5py.Group):
        raise Unlike(f"no group {parent.name.rstrip('/')}/{name}")
    return found


def _dataset(group: Any, name: str) -> Any:
    """Return a data set as h5py's low-level object; h5py's `Dataset` would open several objects."""
    import h5py

    try:
        found = h5py.h5o.open(group.id, name.encode())
    except KeyError:
        found = None
    if not isinstance(found, h5py.h5d.DatasetID):
        raise Unlike(f"no data set {group.name}/{name}")
    return found
