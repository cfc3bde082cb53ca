"""Run files as `rig run` leaves them, read even where the run was killed; layout in `docs/run-file.md`."""

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dic.errors import RunFileError

FORMAT = "offaxis-run"
VERSION = 1


@dataclass(frozen=True)
class RunStep:
    """A finished step: what was asked and what the devices read once settled; NaN without the device."""

    index: int
    kind: str
    target: float
    load_n: float
    displacement_mm: float
    angle_deg: float
    time_s: float


@dataclass(frozen=True)
class RunInfo:
    """What is said of the run as a whole."""

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

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = self._open()
        try:
            self._read()
        except (KeyError, OSError, ValueError) as error:
            self._file.close()
            raise self._damaged("a run file that lacks some of its data or is damaged") from error
        except RunFileError:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def series(self) -> list[RunStep]:
        """Return the steps with images of the specimen: the reference first, then the others."""
        return [step for step in self.steps if step.kind != "grid"]

    def step_of_kind(self, kind: str) -> RunStep:
        """Return the step of kind "grid" or "reference", of which a run has one."""
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
        """Return a camera's image of a step, (height, width), grey levels; the mean of several."""
        row = self.steps.index(step)
        table = self._entry["steps"]
        first, count = int(table[f"frames_{camera}"][row]), int(table[f"count_{camera}"][row])
        detector = self._entry["instrument"][camera]
        try:
            if count < 1 or not detector["valid"][first : first + count].all():
                raise ValueError("rows without pixels")
            frames = detector["data"][first : first + count]
        except (OSError, ValueError) as error:
            raise self._damaged(f"damaged images of {camera} at step {step.index}") from error
        return np.asarray(frames.mean(axis=0, dtype=np.float64), np.float32)

    def _open(self) -> Any:
        if not self.path.is_file():
            raise self._damaged("no such file")
        try:
            return open_run(self.path)
        except OSError as error:
            raise self._damaged("a file that was cut off or is no HDF5") from error

    def _read(self) -> None:
        attributes = self._file.attrs
        if attributes.get("file_format") != FORMAT:
            raise self._damaged("an HDF5 file of another kind")
        if attributes["file_format_version"] != VERSION:
            raise self._damaged(f"version {attributes['file_format_version']}, newer than this program")
        entry = self._entry = self._file["entry"]
        values: dict[str, Any] = {name: _text(entry[name]) for name in _TEXTS}
        values |= {name: float(entry["sample"][name][()]) for name in _LENGTHS}
        simulated = bool(entry.attrs["simulated"])
        self.info = RunInfo(**values, simulated=simulated, sample=_text(entry["sample"]["name"]))
        lines = entry["grid"]["lines"][:]
        self.grid_lines = int(lines[0]), int(lines[1])
        self.grid_pitch_mm = float(entry["grid"]["pitch_mm"][()])
        detectors = entry["instrument"]
        self.cameras = [name for name in detectors if "data" in detectors[name]]
        self.steps = self._finished_steps(entry["steps"])

    @staticmethod
    def _finished_steps(table: Any) -> list[RunStep]:
        # A step is complete once its last column has its row; a killed run may have longer first columns.
        complete = table["complete"][:]
        n = int(np.argmin(complete)) if not complete.all() else len(complete)
        kinds = [kind.decode() for kind in table["kind"][:n]]
        columns = {name: table[name][:n] for name in _COLUMNS}
        return [
            RunStep(int(table["index"][k]), kinds[k], **{name: float(columns[name][k]) for name in _COLUMNS})
            for k in range(n)
        ]

    def _damaged(self, got: str) -> RunFileError:
        return RunFileError(
            str(self.path),
            "read run",
            f"a run file of version {VERSION}",
            got,
            "name a file written by `rig run`, or copy it again",
        )


def open_run(path: Path) -> Any:
    """Open the HDF5 file of a run, also one that is being recorded or whose writer was killed.

    Raises
    ------
    OSError
        If it was cut off or is no HDF5.
    """
    import h5py

    try:
        # Not SWMR first: reading a file that was cut off, SWMR waits without end for a writer to complete it.
        return h5py.File(path, "r")
    except OSError as error:
        if "already open for write" not in str(error):
            raise
        return h5py.File(path, "r", swmr=True)


_TEXTS = (
    "title", "run_id", "status", "status_reason", "start_time", "definition", "configuration", "versions",
)  # fmt: skip
_LENGTHS = ("thickness_mm", "width_mm", "gauge_length_mm")
_COLUMNS = ("target", "load_n", "displacement_mm", "angle_deg", "time_s")


def _text(dataset: Any) -> str:
    return str(bytes(dataset[()]).rstrip(b"\0").decode())
