"""The reader of run files, including files of killed runs; `schema` defines the layout."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dic.errors import RunFileError
from dic.runfile import schema


@dataclass(frozen=True)
class RunStep:
    """A finished step: its target and the settled readings of the devices; NaN for a missing device."""

    index: int
    kind: str
    target: float
    load_n: float
    displacement_mm: float
    angle_deg: float
    time_s: float


@dataclass(frozen=True)
class RunInfo:
    """Properties of the run as a whole."""

    title: str
    run_id: str
    status: str
    status_reason: str
    start_time: str
    simulated: bool
    sample: str
    thickness_mm: float
    width_mm: float
    gauge_length_mm: float
    definition: str
    configuration: str
    versions: str


class RunFile:
    """One run, open for reading; use it in a `with` statement.

    Attributes
    ----------
    info : RunInfo
    grid_lines : tuple of int
        Lines of the calibration grid along X and Y.
    grid_pitch_mm : float
    cameras : list of str
    steps : list of RunStep
        Every finished step, in order.

    Raises
    ------
    RunFileError
        If the file is missing, cut off, damaged or no run file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = self._open()
        try:
            self._read()
        except _UNREADABLE as error:
            self._file.close()
            raise self._damaged("a run file that lacks some of its data or is damaged") from error
        except RunFileError:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def series(self) -> list[RunStep]:
        """Return the steps with images of the specimen: the reference first, then the others."""
        return [step for step in self.steps if step.kind != "grid"]

    def step_of_kind(self, kind: str) -> RunStep:
        """Return the step of kind "grid" or "reference"; a run has one step of each."""
        for step in self.steps:
            if step.kind == kind:
                return step
        raise RunFileError(
            str(self.path),
            "read run",
            f"a finished {kind} step",
            f"{len(self.steps)} other steps",
            "the run ended before; run the protocol again",
        )

    def image(self, camera: str, step: RunStep) -> NDArray[np.float32]:
        """Return a camera's image of a step, (height, width), grey levels: the mean of its frames."""
        rows = self.rows(camera, step)
        try:
            if not rows or set(rows) - set(self.rows_on_file(camera)):
                raise ValueError("rows without pixels")
            frames = self._detectors[camera][schema.PIXELS][rows.start : rows.stop]
        except _UNREADABLE as error:
            raise self._damaged(f"damaged images of {camera} at step {step.index}") from error
        return np.asarray(frames.mean(axis=0, dtype=np.float64), np.float32)

    def rows(self, camera: str, step: RunStep) -> range:
        """Return the rows of a camera's frames of a step."""
        return self._rows[camera][self.steps.index(step)]

    def rows_on_file(self, camera: str) -> list[int]:
        """Return the rows of a camera with completely written pixels."""
        return self._rows_on_file[camera]

    def damaged_rows(self, camera: str) -> list[int]:
        """Read all stored frames of a camera; return the rows with a wrong checksum."""
        return [row for row in self.rows_on_file(camera) if not self._reads(camera, row)]

    def _reads(self, camera: str, row: int) -> bool:
        try:
            self._detectors[camera][schema.PIXELS][row]
        except _UNREADABLE:
            return False
        return True

    def _open(self) -> Any:
        if not self.path.is_file():
            raise self._damaged("no such file")
        try:
            return _open_hdf5(self.path)
        except OSError as error:
            raise self._damaged("a file that was cut off or is no HDF5") from error

    def _read(self) -> None:
        attributes = self._file.attrs
        if attributes.get("file_format") != schema.FORMAT:
            raise self._damaged("an HDF5 file of another kind")
        if attributes["file_format_version"] != schema.VERSION:
            raise self._damaged(f"version {attributes['file_format_version']}, newer than this program")
        entry = self._file["entry"]
        run, sample = _scalars(entry, schema.ENTRY), _scalars(entry["sample"], schema.SAMPLE)
        # No caller needs the time of the end: the status says whether a run has ended.
        del run["end_time"]
        simulated = bool(entry.attrs["simulated"])
        self.info = RunInfo(simulated=simulated, sample=sample.pop("name"), **run, **sample)
        lines = entry["grid"]["lines"][:]
        self.grid_lines = int(lines[0]), int(lines[1])
        self.grid_pitch_mm = float(entry["grid"]["pitch_mm"][()])
        self._detectors = entry["instrument"]
        self.cameras = [name for name, group in self._detectors.items() if schema.PIXELS in group]
        self.steps = self._finished_steps(entry["steps"])
        self._rows = {name: self._rows_of_steps(entry["steps"], name) for name in self.cameras}
        self._rows_on_file = {
            name: np.flatnonzero(self._detectors[name]["valid"][:]).tolist() for name in self.cameras
        }

    @staticmethod
    def _finished_steps(table: Any) -> list[RunStep]:
        # A step is complete when the last column has its row; first columns of a killed run may be longer.
        complete = table[schema.COMPLETE.name][:]
        n = int(np.argmin(complete)) if not complete.all() else len(complete)
        columns = {item.name: table[item.name][:n].tolist() for item in schema.STEP_ITEMS}
        columns["kind"] = [kind.decode() for kind in columns["kind"]]
        rows = zip(*columns.values(), strict=True)
        return [RunStep(**dict(zip(columns, row, strict=True))) for row in rows]

    def _rows_of_steps(self, table: Any, camera: str) -> list[range]:
        columns = (
            table[name(camera)][: len(self.steps)].tolist() for name in (schema.first_row, schema.row_count)
        )
        return [range(first, first + count) for first, count in zip(*columns, strict=True)]

    def _damaged(self, got: str) -> RunFileError:
        return RunFileError(
            str(self.path),
            "read run",
            f"a run file of version {schema.VERSION}",
            got,
            "name a file written by `rig run`, or copy it again",
        )


def _open_hdf5(path: Path) -> Any:
    """Open the HDF5 file of a run, even during recording or after its writer was killed.

    Raises
    ------
    OSError
        If the file is cut off or not HDF5.
    """
    import h5py

    try:
        # Do not try SWMR first: on a file that was cut off, SWMR waits forever for a writer.
        return h5py.File(path, "r")
    except OSError as error:
        if "already open for write" not in str(error):
            raise
        return h5py.File(path, "r", swmr=True)


_UNREADABLE = (KeyError, OSError, RuntimeError, ValueError)
"""Exceptions of h5py for data that are missing, cut off or fail their checksum."""


def _scalars(group: Any, layout: schema.Group) -> dict[str, Any]:
    """Return the values of a group without tables, texts as str and numbers as float."""
    return {
        item.name: float(group[item.name][()]) if item.text_bytes is None else _text(group[item.name])
        for item in layout.items
    }


def _text(dataset: Any) -> str:
    return str(bytes(dataset[()]).rstrip(b"\0").decode())
