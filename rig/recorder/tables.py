"""Create and fill the HDF5 groups, datasets and tables of a run file. `dic.runfile.schema` describes them."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t
from numpy.typing import NDArray

from dic.runfile import schema
from drivers.interfaces import CameraInfo, Frame
from rig.recorder.records import RunHeader

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_CHUNK_ROWS = 256


class Table:
    """A table of the run file, which is an HDF5 group with one dataset for each column."""

    def __init__(self, group: Any, layout: schema.GroupLayout) -> None:
        self._length = 0
        self._rows: list[Mapping[str, Any]] = []
        self._again: dict[int, Mapping[str, Any]] = {}
        *self._columns, self._last = (_Column(group, item) for item in layout.items)

    def append(self, **values: Any) -> None:
        """Keep a row in memory until `write` is called."""
        self._rows.append(values)

    def extend(self, columns: Mapping[str, Sequence[Any] | NDArray[Any]]) -> None:
        """Keep several rows in memory, given by their columns."""
        self._rows += [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]

    def replace(self, row: int, **values: Any) -> None:
        """Keep new values of a row in memory until `write` is called."""
        self._again[row] = values

    def put_at_once(self, row: int, name: str, value: Any) -> None:
        """Write and flush the value of one column in a row that exists."""
        for column in (*self._columns, self._last):
            if column.name == name:
                column.put_again(row, {name: value})

    @property
    def length(self) -> int:
        """Number of rows, without those that `write` has still to append."""
        return self._length + len(self._rows)

    def has(self, row: int) -> bool:
        """Return whether the last values of a row are written."""
        return row < self._length and row not in self._again

    def write(self) -> None:
        """Write and flush all columns of the collected rows except the last column."""
        for column in self._columns:
            if self._rows:
                column.put(self._length, self._rows)
            for row, values in self._again.items():
                column.put_again(row, values)

    def acknowledge(self) -> None:
        """Write and flush the last column of the collected rows, which marks these rows as complete."""
        for row, values in self._again.items():
            self._last.put_again(row, values)
        self._again.clear()
        if self._rows:
            self._last.put(self._length, self._rows)
            self._length += len(self._rows)
            self._rows.clear()


class _Column:
    """A column of a table, which is written with h5py's low-level functions.

    A run writes all columns at each reading of a device. Assignments to an h5py dataset would take nine times
    as long, because each of them determines the types and the selection again, and makes new HDF5 objects.
    """

    def __init__(self, group: Any, item: schema.Item) -> None:
        self.name, self._dtype = item.name, _dtype(item)
        self._type = _type(self._dtype)
        self._dataset = create_dataset(group, item, self._dtype, *_growing())
        self._place = self._dataset.get_space()

    def put(self, first: int, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write and flush this column's values of `rows`, beginning at the row `first` of the table."""
        end = first + len(rows)
        self._dataset.set_extent((end,))
        self._place.set_extent_simple((end,), (h5s.UNLIMITED,))
        self._write(first, rows)

    def put_again(self, row: int, values: Mapping[str, Any]) -> None:
        """Write and flush this column's value in a row that exists."""
        self._write(row, [values])

    def _write(self, first: int, rows: Sequence[Mapping[str, Any]]) -> None:
        count = len(rows)
        values = [row[self.name] for row in rows]
        if self._dtype.kind == "S":
            values = [fit(text, self._dtype.itemsize) for text in values]
        self._place.select_hyperslab((first,), (count,))
        self._dataset.write(_rows_in_memory(count), self._place, np.array(values, self._dtype), self._type)
        self._dataset.flush()


@cache
def _rows_in_memory(count: int) -> Any:
    """Return the HDF5 dataspace of `count` consecutive values."""
    return h5s.create_simple((count,))


class CameraTable:
    """The images of one camera, and the table with one row for each image. Each image is one HDF5 chunk.

    `descriptor` is the open run file, to which the pixels are written.
    """

    def __init__(self, instrument: Any, name: str, info: CameraInfo, descriptor: int) -> None:
        group = create_group(instrument, name, schema.DETECTOR, info)
        dtype = np.dtype(np.uint8 if info.bits <= 8 else np.uint16)
        self.data = h5py.Dataset(_create_pixels(group, (info.height_px, info.width_px), dtype))
        self.data.attrs.update(schema.PIXELS_ATTRIBUTES)
        self.group, self.table, self._descriptor = group, Table(group, schema.DETECTOR), descriptor
        self._rows: list[tuple[int, Mapping[str, Any], Future[str]]] = []

    def put(self, row: int, frame: Frame, step: int, digest: "Future[str]", order: int) -> None:
        """Write the pixels of an image, and keep the image's row in memory until `write` is called.

        `row` is the first free row of the table, or an earlier one, whose image is overwritten.
        """
        image = np.ascontiguousarray(frame.image, self.data.dtype)
        if image.shape != self.data.shape[1:]:
            expected, got = self.data.shape[1:], image.shape
            raise ValueError(f"an image of shape {got} where {expected} was announced")
        if row < self.data.shape[0]:
            self._give_up_image(row, step)
        else:
            self.data.resize(row + 1, axis=0)
        # h5py would hold Python's lock while it writes the pixels, and all other threads would wait for the
        # disk.
        place = self.data.id.get_chunk_info_by_coord((row, 0, 0))
        _write_all(self._descriptor, image, place.byte_offset)
        values = {
            "exposed_s": frame.exposed_s,
            "received_s": frame.received_s,
            "utc_ns": (frame.utc - _EPOCH) // timedelta(microseconds=1) * 1000,
            "sequence": frame.sequence,
            "flags": frame.flags,
            "exposure_us": frame.exposure_us,
            "gain": frame.gain,
            "middle_s": frame.middle[0],
            "middle_std_s": frame.middle[1],
            "step": step,
            "order": order,
            "valid": 1,
        }
        self._rows.append((row, values, digest))

    def write(self) -> None:
        """Flush the index of the pixels, then write and flush all columns of the rows except ``valid``."""
        self.data.flush()
        for row, values, digest in self._rows:
            if row < self.table.length:
                self.table.replace(row, digest=digest.result(), **values)
            else:
                self.table.append(digest=digest.result(), **values)
        self._rows.clear()
        self.table.write()

    def _give_up_image(self, row: int, step: int) -> None:
        """Mark a row whose image is overwritten, before its pixels change.

        The row first belongs to the new step, so that readers leave out the step of the old image. Then the
        row is not valid, until all of it is new.
        """
        if not self.table.has(row) or any(row == waiting for waiting, _, _ in self._rows):
            self.write()
            self.table.acknowledge()
        self.table.put_at_once(row, "step", step)
        self.table.put_at_once(row, "valid", 0)


def _create_pixels(group: Any, shape: tuple[int, int], dtype: np.dtype[Any]) -> Any:
    """Create the dataset of a camera's images, whose growth reserves the bytes of each image in the file."""
    properties = _properties().copy()
    # Use no HDF5 filter, because HDF5's own checksum (fletcher32) takes five times as long as a SHA-256.
    properties.set_chunk((1, *shape))
    properties.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5d.FILL_TIME_NEVER)
    space = h5s.create_simple((0, *shape), (h5s.UNLIMITED, *shape))
    return h5d.create(group.id, schema.PIXELS.encode(), _type(dtype), space, properties)


def _write_all(descriptor: int, image: NDArray[Any], offset: int) -> None:
    left = image.data.cast("B")
    while left:
        count = os.pwrite(descriptor, left, offset)
        left, offset = left[count:], offset + count


def create_entry(file: Any, header: RunHeader) -> Any:
    """Create the group `/entry` of a run file with all data that are known before the run."""
    file.attrs.update(schema.ROOT_ATTRIBUTES)
    entry = create_group(file, "entry", schema.ENTRY, header)
    texts = {
        "title": header.title,
        "run_id": header.run_id,
        "definition": header.definition,
        "configuration": header.configuration,
        "start_time": header.start.isoformat(),
        "versions": header.versions,
        "provenance": header.provenance,
        "continues": header.continues,
        "end_time": "",
        "status": "running",
        "status_reason": "",
    }
    _fill(entry, schema.ENTRY, texts)
    _fill(create_group(entry, "sample", schema.SAMPLE), schema.SAMPLE, header.sample.model_dump())
    grid = {
        "lines": header.grid.counts,
        "pitch_mm": header.grid.pitch_mm,
        "target": header.grid.target,
        "marker_mm": getattr(header.grid, "marker_mm", np.nan),
        "dictionary": getattr(header.grid, "dictionary", ""),
        "grid_made": header.grid.grid_made or "",
    }
    for item in schema.MAKING[1:]:
        stated = getattr(header.grid, item.name)
        grid[item.name] = np.nan if stated is None else stated
    _fill(create_group(entry, "grid", schema.GRID), schema.GRID, grid)
    mounting = header.mounting
    declared = {
        "plate_mm": np.nan if mounting.plate_mm is None else mounting.plate_mm,
        "tilt_axis_mm": mounting.hinge_mm or (np.nan, np.nan),
        "shift_std_um": np.nan if mounting.shift_std_um is None else mounting.shift_std_um,
        "fixed_face": mounting.fixed_face or "",
    }
    _fill(create_group(entry, schema.MOUNTING_GROUP, schema.MOUNTING), schema.MOUNTING, declared)
    return entry


def create_group(parent: Any, name: str, layout: schema.GroupLayout, described: object = None) -> Any:
    """Create a group, and copy the attributes of `described` that `layout` names to HDF5 attributes."""
    group = parent.create_group(name)
    _set_text(group.id, "NX_class", layout.nx_class)
    for attribute in layout.attributes:
        value = getattr(described, attribute)
        if isinstance(value, str):
            _set_text(group.id, attribute, value)
        else:
            group.attrs[attribute] = value
    return group


def create_text(group: Any, item: schema.Item, text: str) -> None:
    """Create a dataset with one text."""
    content = fit(text, item.text_bytes or len(text.encode()))
    _create_filled(group, item, np.array(content, _dtype(item, len(content))))


def _create_filled(group: Any, item: schema.Item, values: NDArray[Any]) -> None:
    """Create a dataset with the given values, which cannot grow."""
    space = h5s.create_simple(values.shape) if values.shape else h5s.create(h5s.SCALAR)
    create_dataset(group, item, values.dtype, space, _properties()).write(h5s.ALL, h5s.ALL, values)


def create_dataset(group: Any, item: schema.Item, dtype: np.dtype[Any], space: Any, properties: Any) -> Any:
    """Create a dataset with its unit, and return h5py's low-level object.

    A run begins by creating about 100 datasets, for which h5py's own `create_dataset` takes three times as
    long. `space` and `properties` are HDF5's dataspace and creation properties of the dataset.
    """
    dataset = h5d.create(group.id, item.name.encode(), _type(dtype), space, properties)
    if item.text_bytes is None:
        _set_text(dataset, "units", item.units)
    return dataset


def _set_text(identifier: Any, name: str, text: str) -> None:
    """Give an HDF5 object an attribute with a text of variable length."""
    dtype, stored, in_memory, space = _any_text()
    h5a.create(identifier, name.encode(), stored, space).write(np.array(text, dtype), in_memory)


@cache
def _any_text() -> tuple[np.dtype[Any], Any, Any, Any]:
    """Return the type of a text of variable length, its HDF5 types in file and memory, and its dataspace."""
    dtype = h5py.string_dtype()
    return dtype, _type(dtype), h5t.py_create(dtype), h5s.create(h5s.SCALAR)


def _dtype(item: schema.Item, text_bytes: int = 0) -> np.dtype[Any]:
    """Return the declared type. `text_bytes` is the size of a text without a declared size."""
    if item.text_bytes is None:
        return np.dtype(item.dtype)
    # HDF5 texts must have at least one byte.
    dtype: np.dtype[Any] = h5py.string_dtype("utf-8", max(item.text_bytes or text_bytes, 1))
    return dtype


def _type(dtype: np.dtype[Any]) -> Any:
    """Return the HDF5 type of values in the file."""
    return h5t.py_create(dtype, logical=True)


@cache
def _growing() -> tuple[Any, Any]:
    """Return the dataspace and the creation properties of a column without rows."""
    properties = _properties().copy()
    properties.set_chunk((_CHUNK_ROWS,))
    return h5s.create_simple((0,), (h5s.UNLIMITED,)), properties


@cache
def _properties() -> Any:
    """Return the creation properties of all datasets, without a date, because the run file has one."""
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    return properties


def fit(text: str, size: int) -> bytes:
    """Encode `text`, and cut it off after at most `size` bytes without splitting a character."""
    return text.encode()[:size].decode(errors="ignore").encode()


def _fill(group: Any, layout: schema.GroupLayout, values: Mapping[str, Any]) -> None:
    """Create all datasets of a group, and write their values."""
    for item in layout.items:
        value = values[item.name]
        if isinstance(value, str):
            create_text(group, item, value)
        else:
            _create_filled(group, item, np.array(value, item.dtype))
