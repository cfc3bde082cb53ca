"""The reader of run files. The reader also reads the file of a run that was killed before its end.

The module `schema` defines the layout of the file.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, get_args

import numpy as np
from numpy.typing import NDArray

from dic.errors import RunFileError
from dic.hdf5.open import NotReadable, open_hdf5
from dic.runfile import schema, superblock
from dic.runfile.channels import read_channels
from dic.runfile.chunks import pixel_places
from dic.runfile.digests import file_digest, frame_digest, joined_digest, read_user_block
from dic.runfile.interlocks import RANGE, read_interlocks
from dic.runfile.layout import Unlike, camera_names, require_layout
from dic.runfile.mounting import read_making, read_mounting
from dic.runfile.settings import Setting, settings_of
from dic.runfile.steps import RunStep as RunStep, read_step_table
from dic.runfile.values import read_object, read_scalars, read_text, require_known


@dataclass(frozen=True)
class RunInfo:
    """The properties of a run as a whole: its title, status, specimen and configuration.

    `direction_deg` is the angle between the load and the rolling direction, or None if it is not known.
    """

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
    direction_deg: float | None = None


class RunFile:
    """A run file that is open for reading; use this class in a `with` statement.

    Attributes
    ----------
    info : RunInfo
    grid_lines : tuple of int
        Numbers of lines of the calibration grid along X and along Y.
    continues : dict or None
        The earlier run that this run continues; None for a run that begins anew.
    grid_target : str
        Kind of the calibration target: "lines", "checkerboard", "charuco", "dots" or "asymmetric-dots". For a
        target without lines, `grid_lines` are the numbers of squares or dots.
    grid_values : dict of str to float or str
        Further values: `pitch_mm`, and `marker_mm` and `dictionary`, which only a ChArUco board uses.
    grid_making : dict of str to float or str
        How accurately the target was made, as `read_making` returns it.
    mounting : RunMounting
        The declared mounting of grid and specimen.
    cameras : list of str
        Names of the cameras.
    interlocks : dict of str to RunInterlock
        The interlocks by name; empty for a run without interlocks.
    channels : dict of str to (dict of str to RunSignal)
        The signals of each channel device, by the device's and the signal's name; empty for a run without
        channels.
    steps : list of RunStep
        All finished steps, in order.
    overwritten : int
        Number of finished steps whose images were overwritten by later ones; they are not in `steps`.

    Raises
    ------
    RunFileError
        If the file is missing, cut off or damaged, or is not a run file.
    """

    grid_target = "lines"

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = self._open()
        try:
            self._read()
        except Unlike as error:
            self._file.close()
            raise self._damaged(f"a damaged run file, with {error}") from error
        except _UNREADABLE as error:
            self._file.close()
            raise self._damaged("a run file that lacks some of its data or is damaged") from error
        except RunFileError:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; a repeated call has no effect."""
        self._file.close()

    def series(self) -> list[RunStep]:
        """Return the steps with images of the specimen, in order; the first one is the reference step."""
        return [step for step in self.steps if step.kind != "grid"]

    def step_of_kind(self, kind: str) -> RunStep:
        """Return the first step of the given kind, for example "grid" or "reference".

        Raises
        ------
        RunFileError
            If the run ended before such a step was finished.
        """
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

    def image(self, camera: str, step: RunStep, *, stored: bool = False) -> NDArray[Any]:
        """Return the mean of a camera's frames at a step: grey levels, shape (height, width).

        The result is float32. With `stored`, a single frame has the integer type of the file.

        Raises
        ------
        RunFileError
            If a frame of the step is missing or damaged.
        """
        rows = self.rows(camera, step)
        try:
            if not rows or set(rows) - set(self.rows_on_file(camera)):
                raise ValueError("rows without pixels")
            frames = [self._frame(camera, row) for row in rows]
        except _UNREADABLE as error:
            raise self._damaged(f"damaged images of {camera} at step {step.index}") from error
        if len(frames) == 1:
            return frames[0] if stored else frames[0].astype(np.float32)
        return np.asarray(np.mean(frames, axis=0, dtype=np.float64), np.float32)

    def digest(self, camera: str, step: RunStep) -> str:
        """Return a SHA-256 over the digests of a camera's frames at a step.

        Raises
        ------
        RunFileError
            If a frame of the step is missing or damaged.
        """
        group, rows = self._detectors[camera], self.rows(camera, step)
        # Files of earlier versions have HDF5's own checksums instead of digests.
        if schema.DIGEST.name not in group:
            return frame_digest(self.image(camera, step))
        try:
            return joined_digest(read_text(group[schema.DIGEST.name], row) for row in rows)
        except _UNREADABLE as error:
            raise self._damaged(f"damaged digests of {camera} at step {step.index}") from error

    def rows(self, camera: str, step: RunStep) -> range:
        """Return the row numbers of the frames that a camera took at a step."""
        return self._rows[camera][self.place(step)]

    def place(self, step: RunStep) -> int:
        """Return the index of a step in `steps`."""
        found = self._places.get(id(step))
        return self.steps.index(step) if found is None else found

    def rows_on_file(self, camera: str) -> list[int]:
        """Return the row numbers of those frames of a camera whose pixels are completely written."""
        return self._rows_on_file[camera]

    def damaged_rows(self, camera: str) -> list[int]:
        """Read all complete frames of a camera and return the row numbers of the unreadable frames.

        A frame is unreadable if, for example, its checksum is wrong.
        """
        return [row for row in self.rows_on_file(camera) if not self._reads(camera, row)]

    def frame(self, camera: str, row: int) -> NDArray[Any]:
        """Return one frame of a camera as it was recorded, after a check of its digest.

        Raises
        ------
        RunFileError
            If the frame is missing or damaged.
        """
        try:
            return self._frame(camera, row)
        except _UNREADABLE as error:
            raise self._damaged(f"a damaged image {row} of {camera}") from error

    def columns(self, table: str, *names: str) -> dict[str, NDArray[Any]]:
        """Return the complete rows of a table in the file's group `entry`, by column.

        A table's name is, for example, "instrument/stage" or, for the interlock door and the channel device
        box, "interlocks/door" and "channels/box". A table that the run does not have gives an empty dict.
        With `names`, only these columns are read, if they exist.
        """
        try:
            group = self._file["entry"].get(table)
            if group is None:
                return {}
            columns = {name: data for name, data in group.items() if data.ndim == 1}
            rows = min(len(data) for data in columns.values())
            return {name: data[:rows] for name, data in columns.items() if not names or name in names}
        except _UNREADABLE as error:
            raise self._damaged(f"a damaged table {table}") from error

    def image_shape(self, camera: str) -> tuple[int, int]:
        """Return height and width of a camera's images in px."""
        height, width = self._detectors[camera][schema.PIXELS].shape[1:]
        return int(height), int(width)

    def identity(self, device: str) -> dict[str, Any]:
        """Return vendor, model, serial number and firmware of a device, and the bits of a camera.

        A device's name is a camera's name, "stage", "load_frame" or, for the interlock door and the channel
        device box, "interlocks.door" and "channels.box".
        """
        attributes = self._group_of(device).attrs.items()
        return {key: value for key, value in attributes if key not in {"NX_class", *RANGE}}

    def _group_of(self, device: str) -> Any:
        folder, dot, name = device.partition(".")
        return self._file["entry"][folder][name] if dot else self._detectors[device]

    def asked(self, device: str) -> dict[str, Any]:
        """Return what was recorded about a device's settings before the run; empty for earlier versions.

        The keys are `driver`, `asked` (the settings in the rig file) and `reports_settings` (True if the
        driver reads the settings back).
        """
        group = self._group_of(device)
        try:
            return (
                read_object(read_text(group[schema.SETTINGS.name])) or {}
                if schema.SETTINGS.name in group
                else {}
            )
        except _UNREADABLE as error:
            raise self._damaged(f"damaged settings of {device}") from error

    def settings(self, device: str, moment: schema.Moment) -> dict[str, Setting]:
        """Return the settings that a device reported at the start or at the end of the run, by name.

        The names of devices are those of `identity`. The dict is empty if the device reported nothing.

        Raises
        ------
        RunFileError
            If the table of settings is damaged.
        """
        try:
            return settings_of(self.columns(schema.REPORTED_GROUP), device, moment)
        except _UNREADABLE as error:
            raise self._damaged(f"damaged settings of {device}") from error

    def _reads(self, camera: str, row: int) -> bool:
        try:
            self._frame(camera, row)
        except _UNREADABLE:
            return False
        return True

    def _frame(self, camera: str, row: int) -> NDArray[Any]:
        """Return one frame; raise ValueError if the frame's digest is wrong."""
        group = self._detectors[camera]
        frame: NDArray[Any] = group[schema.PIXELS][row]
        # Files of earlier versions have HDF5's own checksums instead of digests.
        if schema.DIGEST.name in group and read_text(group[schema.DIGEST.name], row) != frame_digest(frame):
            raise ValueError("a frame with a wrong digest")
        return frame

    def digest_matches(self) -> bool | None:
        """Return whether the digest of a closed file is right; None if the file has no digest.

        The digest of the file covers all bytes except the pixels of images. The images have digests of their
        own, which the method `damaged_rows` checks.
        """
        if not superblock.find(self.path):
            return None
        if not superblock.is_closed(self.path):
            # Do not read the file here, because any amount of data may have been appended to it.
            return None if self.info.status == "running" else False
        block = read_user_block(self.path)
        if block is None or not block.sha256:
            # The file of a killed run has a user block without a digest, or no user block yet.
            return None if block is not None or self.info.status == "running" else False
        places = []
        for name in self.cameras:
            stored = pixel_places(self._detectors[name][schema.PIXELS])
            places += [stored[row] for row in self.rows_on_file(name) if row in stored]
        return block.sha256 == file_digest(self.path, places, block.size)

    def _open(self) -> Any:
        try:
            return open_hdf5(self.path)
        except NotReadable as error:
            raise self._damaged(str(error)) from error

    def _read(self) -> None:
        attributes = self._file.attrs
        if attributes.get("file_format") != schema.FORMAT:
            if attributes.get("file_format") == _RESULTS:
                remedy = "give it to `dic report`"
                raise RunFileError(str(self.path), "read run", "a run file", "a result file", remedy)
            raise self._damaged("an HDF5 file of another kind")
        require_known(self.path, self._file)
        require_layout(self._file)
        entry = self._file["entry"]
        run, sample = read_scalars(entry, schema.ENTRY), read_scalars(entry["sample"], schema.SAMPLE)
        # Files of earlier versions have no provenance.
        run.pop(schema.PROVENANCE.name, None)
        self.continues = read_object(str(run.pop(schema.CONTINUES.name, "")))
        # No caller needs the end time. The status tells whether a run has ended.
        del run["end_time"]
        simulated = bool(entry.attrs["simulated"])
        direction_deg = sample.pop(schema.DIRECTION.name, math.nan)
        sample[schema.DIRECTION.name] = None if math.isnan(direction_deg) else direction_deg
        self.info = RunInfo(simulated=simulated, sample=sample.pop("name"), **run, **sample)
        if self.info.status not in _STATUSES:
            raise Unlike(f"the status {self.info.status!r}")
        lines = entry["grid"]["lines"][:]
        self.grid_lines = int(lines[0]), int(lines[1])
        pitch_mm = float(entry["grid"]["pitch_mm"][()])
        if not (min(lines) > 0 and max(lines) <= _LINES_MAX and 0.0 < pitch_mm < np.inf):
            raise Unlike(f"a grid of {lines[0]} x {lines[1]} lines every {pitch_mm:g} mm")
        self.grid_values: dict[str, Any] = {"pitch_mm": pitch_mm}
        # Files of earlier versions have line grids only.
        if schema.TARGET[0].name in entry["grid"]:
            self.grid_target = read_text(entry["grid"]["target"])
            self.grid_values["marker_mm"] = float(entry["grid"]["marker_mm"][()])
            self.grid_values["dictionary"] = read_text(entry["grid"]["dictionary"])
        self.grid_making = read_making(entry["grid"])
        self.mounting = read_mounting(self._file)
        self._detectors = entry["instrument"]
        self.cameras = camera_names(self._file)
        self.interlocks = read_interlocks(self._file)
        self.channels = read_channels(self._file)
        self._rows_on_file = {
            name: np.flatnonzero(self._detectors[name]["valid"][:] == 1).tolist() for name in self.cameras
        }
        table = read_step_table(entry["steps"], {name: self._detectors[name] for name in self.cameras})
        self.steps, self._rows, self.overwritten = table.steps, table.rows, table.overwritten
        self._places = {id(step): place for place, step in enumerate(self.steps)}

    def _damaged(self, got: str) -> RunFileError:
        return RunFileError(
            str(self.path),
            "read run",
            f"a run file of version {schema.VERSION}",
            got,
            "name a file written by `rig run`, copy it again, or try `rig repair`",
        )


_RESULTS = "offaxis-results"
_UNREADABLE = (
    AttributeError, IndexError, KeyError, MemoryError, OSError, OverflowError, RuntimeError, TypeError,
    ValueError,
)  # fmt: skip
"""Exceptions for data that are missing, are cut off, have a wrong checksum, or are of another type."""

_STATUSES = frozenset(get_args(schema.RunStatus))
_LINES_MAX = 1000
