"""Writing the run file so that a killed run still opens with every finished step (docs/run-file.md)."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np

from drivers.interfaces import CameraInfo, DeviceInfo, Frame, LoadFrameState, StageState
from rig.errors import RunFileError
from rig.protocol.protocol import Grid, ProtocolStep, Reading, Sample

FORMAT_VERSION = 1
RunStatus = Literal["running", "completed", "aborted", "failed"]
Level = Literal["info", "warning", "error"]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_REASON_BYTES = 480
_MESSAGE_BYTES = 240

# Per column: type (or bytes of text) and unit; the last column of a table says that the row is complete.
_FRAME_COLUMNS: dict[str, tuple[Any, str]] = {
    "exposed_s": (np.float64, "s"),
    "received_s": (np.float64, "s"),
    "utc_ns": (np.int64, "ns"),
    "sequence": (np.int64, "1"),
    "flags": (np.int64, "1"),
    "exposure_us": (np.float64, "us"),
    "gain": (np.float64, "1"),
    "step": (np.int64, "1"),
    "valid": (np.uint8, "1"),
}
_STAGE_COLUMNS: dict[str, tuple[Any, str]] = {"angle_deg": (np.float64, "deg"), "time_s": (np.float64, "s")}
_LOAD_FRAME_COLUMNS: dict[str, tuple[Any, str]] = {
    "load_n": (np.float64, "N"),
    "displacement_mm": (np.float64, "mm"),
    "time_s": (np.float64, "s"),
}
_EVENT_COLUMNS: dict[str, tuple[Any, str]] = {
    "level": (8, ""),
    "source": (32, ""),
    "message": (_MESSAGE_BYTES, ""),
    "time_s": (np.float64, "s"),
}


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
    """A finished step: what was asked, what was read once settled, and per camera its first row and count."""

    step: ProtocolStep
    reading: Reading
    frames: Mapping[str, tuple[int, int]]


class Recorder:
    """Appends to one run file; all methods raise `RunFileError` when the file cannot be written.

    Parameters
    ----------
    path : Path
        A file that does not exist yet; an existing one is never overwritten.
    header : RunHeader
    cameras : mapping of str to CameraInfo
        By the name in the rig file.
    stage, load_frame : DeviceInfo or None
        None where the rig has no such device.
    """

    def __init__(
        self,
        path: Path,
        header: RunHeader,
        cameras: Mapping[str, CameraInfo],
        *,
        stage: DeviceInfo | None = None,
        load_frame: DeviceInfo | None = None,
    ) -> None:
        self.path = path
        with self._writing("creating the run file"):
            # HDF5 would create the file before it finds the folder unwritable, or truncate on a wrong mode.
            self._file = h5py.File(path, "x", libver="latest")
        with self._writing("creating the run file"):
            self._entry = _create_entry(self._file, header)
            instrument = _group(self._entry, "instrument", "NXinstrument")
            self._cameras = {name: _CameraTable(instrument, name, info) for name, info in cameras.items()}
            self._stage = _device_table(instrument, "stage", "NXpositioner", stage, _STAGE_COLUMNS)
            self._load_frame = _device_table(
                instrument, "load_frame", "NXsensor", load_frame, _LOAD_FRAME_COLUMNS
            )
            self._steps = _Table(_group(self._entry, "steps", "NXcollection"), _step_columns(cameras))
            self._events = _Table(_group(self._entry, "events", "NXcollection"), _EVENT_COLUMNS)
            # Readers that open the file from here on never see what is created later: everything exists now.
            self._file.swmr_mode = True
            self._sync()

    def frame(self, camera: str, frame: Frame) -> int:
        """Append one image and return its row. It belongs to the step that is finished next."""
        with self._writing(f"recording an image of {camera}"):
            return self._cameras[camera].append(frame, step=self._steps.length)

    def frame_state(self, state: LoadFrameState) -> None:
        """Append what the load frame said."""
        if self._load_frame is not None:
            with self._writing("recording the load"):
                self._load_frame.append(
                    load_n=state.load_n, displacement_mm=state.displacement_mm, time_s=state.time_s
                )

    def stage_state(self, state: StageState) -> None:
        """Append what the stage said."""
        if self._stage is not None:
            with self._writing("recording the angle"):
                self._stage.append(angle_deg=state.angle_deg, time_s=state.time_s)

    def step(self, record: StepRecord) -> None:
        """Append a finished step and have the disk keep everything up to here."""
        frames = {f"frames_{name}": first for name, (first, _) in record.frames.items()}
        counts = {f"count_{name}": count for name, (_, count) in record.frames.items()}
        with self._writing(f"recording {record.step}"):
            self._steps.append(
                index=record.step.index,
                kind=record.step.kind,
                target=record.step.target,
                load_n=record.reading.load_n,
                displacement_mm=record.reading.displacement_mm,
                angle_deg=record.reading.angle_deg,
                time_s=record.reading.time_s,
                **frames,
                **counts,
                complete=1,
            )
            self._sync()

    def event(self, time_s: float, level: Level, source: str, message: str) -> None:
        """Append what happened; a message is cut at 240 bytes."""
        with self._writing("recording an event"):
            self._events.append(level=level, source=source, message=message, time_s=time_s)

    def close(self, status: RunStatus, reason: str, end: datetime) -> None:
        """Write how the run ended and close the file; harmless when repeated."""
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
            # h5py reports a full disk as one of the first two, by the call in which it is noticed, and a
            # closed file as the last.
            raise RunFileError(
                str(self.path),
                f"{what} to succeed",
                " ".join(str(error).split()),
                "check free space and permissions of the folder",
            ) from error


def run_file_exists(path: Path) -> RunFileError:
    """Return the error that says why an existing file is left alone."""
    return RunFileError(
        str(path),
        "a new file",
        "one that exists",
        "name another with -o, or move it away: a run is never overwritten",
    )


class _Table:
    """Columns that grow together by one row; the last one is flushed after all others."""

    def __init__(self, group: Any, columns: Mapping[str, tuple[Any, str]]) -> None:
        self.length = 0
        self._columns = {}
        for name, (kind, units) in columns.items():
            dtype = h5py.string_dtype("utf-8", kind) if isinstance(kind, int) else kind
            column = group.create_dataset(name, shape=(0,), maxshape=(None,), dtype=dtype, chunks=(256,))
            if not isinstance(kind, int):
                column.attrs["units"] = units
            self._columns[name] = column

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
    """Images of one camera, one chunk each, and the table that says which of them count."""

    def __init__(self, instrument: Any, name: str, info: CameraInfo) -> None:
        group = _group(instrument, name, "NXdetector")
        _identify(group, info)
        group.attrs["bits"] = info.bits
        shape = (info.height_px, info.width_px)
        self._data = group.create_dataset(
            "data",
            shape=(0, *shape),
            maxshape=(None, *shape),
            chunks=(1, *shape),
            dtype=np.uint8 if info.bits <= 8 else np.uint16,
            fletcher32=True,
        )
        self._data.attrs["units"] = "1"
        self._data.attrs["interpretation"] = "image"
        self._table = _Table(group, _FRAME_COLUMNS)

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
    file.attrs.update(default="entry", file_format="offaxis-run", file_format_version=FORMAT_VERSION)
    entry = _group(file, "entry", "NXentry")
    entry.attrs["simulated"] = header.simulated
    texts = {
        "title": header.title,
        "run_id": header.run_id,
        "definition": header.definition,
        "configuration": header.configuration,
        "start_time": header.start.isoformat(),
        "versions": header.versions,
    }
    for name, text in texts.items():
        _text(entry, name, text, len(text.encode()))
    _text(entry, "end_time", "", 40)
    _text(entry, "status", "running", 16)
    _text(entry, "status_reason", "", _REASON_BYTES)
    sample = _group(entry, "sample", "NXsample")
    _text(sample, "name", header.sample.name, len(header.sample.name.encode()))
    for name in ("thickness_mm", "width_mm", "gauge_length_mm"):
        sample.create_dataset(name, data=getattr(header.sample, name)).attrs["units"] = "mm"
    grid = _group(entry, "grid", "NXcollection")
    grid.create_dataset("lines", data=(header.grid.lines_x, header.grid.lines_y)).attrs["units"] = "1"
    grid.create_dataset("pitch_mm", data=header.grid.pitch_mm).attrs["units"] = "mm"
    return entry


def _step_columns(cameras: Mapping[str, CameraInfo]) -> dict[str, tuple[Any, str]]:
    readings = {"load_n": "N", "displacement_mm": "mm", "angle_deg": "deg", "time_s": "s"}
    rows = [f"{column}_{name}" for name in cameras for column in ("frames", "count")]
    return {
        "index": (np.int64, "1"),
        "kind": (16, ""),
        "target": (np.float64, "by kind: N, mm or deg"),
        **{name: (np.float64, units) for name, units in readings.items()},
        **dict.fromkeys(rows, (np.int64, "1")),
        "complete": (np.uint8, "1"),
    }


def _device_table(
    instrument: Any, name: str, nx_class: str, info: DeviceInfo | None, columns: Mapping[str, tuple[Any, str]]
) -> _Table | None:
    if info is None:
        return None
    group = _group(instrument, name, nx_class)
    _identify(group, info)
    return _Table(group, columns)


def _group(parent: Any, name: str, nx_class: str) -> Any:
    group = parent.create_group(name)
    group.attrs["NX_class"] = nx_class
    return group


def _identify(group: Any, info: DeviceInfo) -> None:
    group.attrs.update(vendor=info.vendor, model=info.model, serial=info.serial, firmware=info.firmware)


def _text(group: Any, name: str, text: str, size: int) -> None:
    group.create_dataset(name, data=_fit(text, size), dtype=h5py.string_dtype("utf-8", max(size, 1)))


def _fit(text: str, size: int) -> bytes:
    """Encode `text` in at most `size` bytes without cutting a character in two."""
    return text.encode()[:size].decode(errors="ignore").encode()
