"""Writing the run file so that a killed run still opens with every finished step (docs/run-file.md)."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dic.runfile import schema
from drivers.interfaces import CameraInfo, DeviceInfo, Frame, LoadFrameState, StageState
from rig.errors import RecordingError
from rig.protocol.protocol import Grid, Sample
from rig.protocol.step import ProtocolStep, Reading

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class RunHeader:
    """What is known of a run before it begins; `definition` and `configuration` are the files as read."""

    title: str
    run_id: str
    definition: str
    configuration: str
    start: datetime
    versions: str
    sample: Sample
    grid: Grid
    simulated: bool


@dataclass(frozen=True)
class StepRecord:
    """A finished step, its settled reading, and per camera the first row and the number of its images."""

    step: ProtocolStep
    reading: Reading
    frames: Mapping[str, tuple[int, int]]


class Recorder:
    """Appends to one run file; all methods raise `RecordingError` when the file cannot be written.

    Parameters
    ----------
    path : str or Path
        A file that does not exist yet; an existing one is never overwritten.
    header : RunHeader
    cameras : mapping of str to CameraInfo
        By the name in the rig file.
    stage, load_frame : DeviceInfo or None
        None where the rig has no such device.
    """

    def __init__(
        self,
        path: str | Path,
        header: RunHeader,
        cameras: Mapping[str, CameraInfo],
        *,
        stage: DeviceInfo | None = None,
        load_frame: DeviceInfo | None = None,
    ) -> None:
        self.path = Path(path)
        with self._writing("creating the run file"):
            # Mode "x" never truncates an existing file.
            self._file = h5py.File(self.path, "x", libver="latest")
        with self._writing("creating the run file"):
            self._entry = _create_entry(self._file, header)
            instrument = _create_group(self._entry, "instrument", schema.INSTRUMENT)
            self._cameras = {name: _CameraTable(instrument, name, info) for name, info in cameras.items()}
            self._stage = _device_table(instrument, "stage", schema.STAGE, stage)
            self._load_frame = _device_table(instrument, "load_frame", schema.LOAD_FRAME, load_frame)
            steps = schema.steps(cameras)
            self._steps = _Table(_create_group(self._entry, "steps", steps), steps)
            self._events = _Table(_create_group(self._entry, "events", schema.EVENTS), schema.EVENTS)
            # SWMR readers never see a dataset that is created later, so every dataset must exist by now.
            self._file.swmr_mode = True
            self._sync()

    def frame(self, camera: str, frame: Frame) -> int:
        """Append one image and return its row. The image belongs to the next step that is finished."""
        with self._writing(f"recording an image of {camera}"):
            return self._cameras[camera].append(frame, step=self._steps.length)

    def load_frame_state(self, state: LoadFrameState) -> None:
        """Append a state of the load frame."""
        if self._load_frame is not None:
            with self._writing("recording the load"):
                self._load_frame.append(
                    load_n=state.load_n, displacement_mm=state.displacement_mm, time_s=state.time_s
                )

    def stage_state(self, state: StageState) -> None:
        """Append a state of the stage."""
        if self._stage is not None:
            with self._writing("recording the angle"):
                self._stage.append(angle_deg=state.angle_deg, time_s=state.time_s)

    def step(self, record: StepRecord) -> None:
        """Append a finished step and synchronise the file with the disk."""
        firsts = {schema.first_row(name): first for name, (first, _) in record.frames.items()}
        counts = {schema.row_count(name): count for name, (_, count) in record.frames.items()}
        with self._writing(f"recording {record.step}"):
            self._steps.append(
                index=record.step.index,
                kind=record.step.kind,
                target=record.step.target,
                load_n=record.reading.load_n,
                displacement_mm=record.reading.displacement_mm,
                angle_deg=record.reading.angle_deg,
                time_s=record.reading.time_s,
                **firsts,
                **counts,
                complete=1,
            )
            self._sync()

    def event(self, time_s: float, level: schema.Level, source: str, message: str) -> None:
        """Append an event; a message is cut at 240 bytes."""
        with self._writing("recording an event"):
            self._events.append(level=level, source=source, message=message, time_s=time_s)

    def close(self, status: schema.RunStatus, reason: str, end: datetime) -> None:
        """Write how the run ended and close the file; a repeated call does nothing."""
        if not self._file:
            return
        with self._writing("closing the run file"):
            try:
                for name, text in (
                    ("status_reason", reason),
                    ("end_time", end.isoformat()),
                    ("status", status),
                ):
                    dataset = self._entry[name]
                    dataset[()] = _fit(text, dataset.dtype.itemsize)
                    dataset.flush()
                self._sync()
            finally:
                self._file.close()

    def _sync(self) -> None:
        # Flushed data survive the death of the program; only fsync makes them survive a power cut.
        self._file.flush()
        os.fsync(self._file.id.get_vfd_handle())

    @contextmanager
    def _writing(self, what: str) -> Iterator[None]:
        try:
            yield
        except FileExistsError as error:
            raise run_file_exists(self.path) from error
        except (OSError, RuntimeError, ValueError) as error:
            # h5py reports a full disk as OSError or RuntimeError, depending on the call, and a closed file
            # as ValueError.
            raise RecordingError(
                str(self.path),
                f"{what} to succeed",
                " ".join(str(error).split()),
                "check free space and permissions of the folder, or name another file with -o",
            ) from error


def run_file_exists(path: Path) -> RecordingError:
    """Return the error for a run file that exists already."""
    return RecordingError(
        str(path),
        "a new file",
        "one that exists",
        "name a new file with -o, or move the file away: a run is never overwritten",
    )


class _Table:
    """Columns that grow together by one row; the last one is flushed after all others."""

    def __init__(self, group: Any, layout: schema.Group) -> None:
        self.length = 0
        self._columns = {
            item.name: _create_dataset(group, item, shape=(0,), maxshape=(None,), chunks=(256,))
            for item in layout.items
        }

    def append(self, **values: Any) -> None:
        *columns, last = self._columns.items()
        for name, column in columns:
            self._put(column, values[name])
            column.flush()
        self._put(last[1], values[last[0]])
        last[1].flush()
        self.length += 1

    def _put(self, column: Any, value: Any) -> None:
        column.resize((self.length + 1,))
        column[self.length] = _fit(value, column.dtype.itemsize) if isinstance(value, str) else value


class _CameraTable:
    """Images of one camera, one chunk each, and the table that marks the valid ones."""

    def __init__(self, instrument: Any, name: str, info: CameraInfo) -> None:
        group = _create_group(instrument, name, schema.DETECTOR, info)
        shape = (info.height_px, info.width_px)
        self._data = group.create_dataset(
            schema.PIXELS,
            shape=(0, *shape),
            maxshape=(None, *shape),
            chunks=(1, *shape),
            dtype=np.uint8 if info.bits <= 8 else np.uint16,
            fletcher32=True,
        )
        self._data.attrs.update(schema.PIXELS_ATTRIBUTES)
        self._table = _Table(group, schema.DETECTOR)

    def append(self, frame: Frame, step: int) -> int:
        row = self._table.length
        self._data.resize(row + 1, axis=0)
        self._data[row] = frame.image
        self._data.flush()
        self._table.append(
            exposed_s=frame.exposed_s,
            received_s=frame.received_s,
            utc_ns=(frame.utc - _EPOCH) // timedelta(microseconds=1) * 1000,
            sequence=frame.sequence,
            flags=frame.flags,
            exposure_us=frame.exposure_us,
            gain=frame.gain,
            step=step,
            valid=1,
        )
        return row


def _create_entry(file: Any, header: RunHeader) -> Any:
    file.attrs.update(schema.ROOT_ATTRIBUTES)
    entry = _create_group(file, "entry", schema.ENTRY, header)
    texts = {
        "title": header.title,
        "run_id": header.run_id,
        "definition": header.definition,
        "configuration": header.configuration,
        "start_time": header.start.isoformat(),
        "versions": header.versions,
        "end_time": "",
        "status": "running",
        "status_reason": "",
    }
    _fill(entry, schema.ENTRY, texts)
    _fill(_create_group(entry, "sample", schema.SAMPLE), schema.SAMPLE, header.sample.model_dump())
    grid = {"lines": (header.grid.lines_x, header.grid.lines_y), "pitch_mm": header.grid.pitch_mm}
    _fill(_create_group(entry, "grid", schema.GRID), schema.GRID, grid)
    return entry


def _device_table(instrument: Any, name: str, layout: schema.Group, info: DeviceInfo | None) -> _Table | None:
    return None if info is None else _Table(_create_group(instrument, name, layout, info), layout)


def _create_group(parent: Any, name: str, layout: schema.Group, described: object = None) -> Any:
    """Create a group; its attributes are copied from the attributes of `described` with the same names."""
    group = parent.create_group(name)
    group.attrs["NX_class"] = layout.nx_class
    group.attrs.update({attribute: getattr(described, attribute) for attribute in layout.attributes})
    return group


def _fill(group: Any, layout: schema.Group, values: Mapping[str, Any]) -> None:
    """Create every dataset of a group with its value."""
    for item in layout.items:
        value = values[item.name]
        if isinstance(value, str):
            text = _fit(value, item.text_bytes or len(value.encode()))
            _create_dataset(group, item, text_bytes=len(text), data=text)
        else:
            _create_dataset(group, item, data=value)


def _create_dataset(group: Any, item: schema.Item, text_bytes: int = 0, **options: Any) -> Any:
    """Create a dataset of the declared type; `text_bytes` is the size of a text without a declared one."""
    if item.text_bytes is None:
        dataset = group.create_dataset(item.name, dtype=item.dtype, **options)
        dataset.attrs["units"] = item.units
        return dataset
    # HDF5 has no text type of zero bytes.
    dtype = h5py.string_dtype("utf-8", max(item.text_bytes or text_bytes, 1))
    return group.create_dataset(item.name, dtype=dtype, **options)


def _fit(text: str, size: int) -> bytes:
    """Encode `text` in at most `size` bytes without cutting a character in two."""
    return text.encode()[:size].decode(errors="ignore").encode()
