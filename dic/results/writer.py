"""Writes result files in HDF5: displacements and strains of series of images.

`docs/results.md` describes the layout of the file.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock
from types import TracebackType
from typing import Any, Self

import numpy as np

from dic.correlation.field import Field
from dic.errors import OutputError, RunFileError
from dic.files.lock import lock_descriptor
from dic.files.writing import reason, require_place
from dic.hdf5.writing import NewFile
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.strain_parts import UNCERTAINTY_KEYS
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.results.fields import write_points
from dic.results.finished import FinishedImage, append_earlier
from dic.results.job import outcome_rows
from dic.results.place import outputs_text
from dic.results.points import strain_values
from dic.results.provenance import Provenance
from dic.results.rows import Rows
from dic.results.schema import (
    FINISHED,
    FORMAT,
    MEAN_KEYS,
    MOUNTING_KEY,
    OUTPUTS,
    PLANE_KEYS,
    SHARED_KEY,
    VERSION,
    CameraLayout,
    units_of,
)
from dic.strain.displacement import Displacement
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain, StrainField

COMMIT_POINTS, COMMIT_IMAGES = 20_000, 64
"""Numbers of points and of images after which a commit is due.

If the program is killed, the images since the last commit must be correlated again, which takes about a
second. A commit takes as long as the correlation of some hundred points.
"""


class ResultWriter:
    """A writer that appends images to a result file one by one; use it in a `with` statement.

    The fields of an image are appended with `add_field` when it is correlated, its strains with `add` when
    they are computed. The file can be read after every commit, even if the program is killed. It appears at
    its place with the first commit, or when it holds as many images as the file that it replaces.

    No fields stay in memory. Several threads may append fields.

    `path`: the file to create. A file at this place is replaced; without any image, it stays. `origin`: where
    the results come from. `outputs`: other files that the measurement writes; see `outputs_of`.
    `images_before`: number of images of a file at the same place, which is replaced when this file has as
    many. Infinity if that file is replaced only at the end.

    `has_results`: True if the file is worth keeping. The writer sets this with the first field.
    """

    def __init__(
        self, path: Path, origin: Provenance, outputs: Iterable[Path] = (), images_before: float = 0
    ) -> None:
        self._path, self._rows, self._before = path, Rows(), images_before
        self._counts: dict[str, int] = {}
        self._images, self._whole, self._published = 0, False, False
        self.has_results = False
        self._turn, self._new_points, self._new_images = RLock(), 0, 0
        try:
            self._place = require_place(path)
            self._partial = self._place.with_name(f".{self._place.name}.{os.getpid()}.partial")
            self._new = NewFile(self._partial, path)
            lock_descriptor(self._new.descriptor())
        except OSError as error:
            expected, remedy = "a folder that can be written to", "name another file"
            raise RunFileError(str(path), "create results", expected, reason(error), remedy) from error
        self._file = self._new.hdf5
        about = {"file_format": FORMAT, "file_format_version": VERSION, FINISHED: np.uint8(0)}
        self._file.attrs.update(about)
        provenance = self._file.create_group("provenance")
        _write_provenance(provenance, origin)
        provenance.attrs[OUTPUTS] = outputs_text(outputs)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            with self._room():
                self._rows.finish()
                if self._whole and error is None:
                    self._file.attrs[FINISHED] = np.uint8(1)
                    del self._file["provenance"].attrs[OUTPUTS]
                self._new.close()
        except BaseException:
            with suppress(OSError, RuntimeError, ValueError):
                self._new.close()
            if not self._published:
                self._partial.unlink(missing_ok=True)
            raise
        self._publish(last=True)

    def finish(self) -> None:
        """Mark the results as whole: no image is missing, and everything else is written."""
        self._whole = True

    def commit(self, *, if_due: bool = False) -> None:
        """Make sure that the file can be read as it is now; if `if_due`, only if much is new.

        Raises `OutputError` if the disk is full.
        """
        with self._turn, self._room():
            if if_due and not self._is_due():
                return
            self._rows.flush()
            self._new.commit()
            self._publish()
            self._new_points = self._new_images = 0

    def _is_due(self) -> bool:
        return self._new_points >= COMMIT_POINTS or self._new_images >= COMMIT_IMAGES

    def _publish(self, *, last: bool = False) -> None:
        """Give the file its name, if it has an image, and no fewer than the file with this name."""
        enough = self._images >= self._before or (last and self._whole)
        if self._published or not (self.has_results and enough):
            if last and not self._published:
                self._partial.unlink()
            return
        with self._partial.open("rb+") as file:
            # Without `fsync`, a power failure after the renaming could leave an empty file.
            os.fsync(file.fileno())
        self._partial.replace(self._place)
        self._published = True

    @contextmanager
    def _room(self) -> Iterator[None]:
        """Within a `with` block: report an error of writing, such as a full disk, in one sentence."""
        try:
            yield
            self._new.require_written()
        except OSError as error:
            expected, remedy = "a disk with room for them", "make room, and give the same command again"
            raise OutputError(str(self._path), "write results", expected, reason(error), remedy) from error

    def group(self, name: str) -> Any:
        """Return the group `name` of the open file; create the group if it does not exist."""
        return self._file.require_group(name)

    def add_field(self, layout: CameraLayout, image: FinishedImage) -> None:
        """Append the outcome of an image's correlation, and its field if it has one."""
        with self._turn, self._room():
            self._images += 1
            self._new_images += 1
            self._rows.append(
                self.group(layout.images), self._next(layout.images), outcome_rows(image.outcome)
            )
            if image.fields is None:
                return
            self.has_results = True
            self._new_points += int(image.field.active.sum())
            field, group = image.field, self._file.get(layout.rows)
            n = self._next(layout.rows)
            if group is None or "x_px" not in group:
                group = self.group(layout.rows)
                group.attrs.update(vars(field.settings))
                write_points(group, field)
            for rows in _field_rows(image, field):
                self._rows.append(group, n, rows)
            append_earlier(group, n, image.fields)

    def stored(self, layout: CameraLayout) -> Any:
        """Return the group with the fields of a camera, to read what was appended."""
        with self._turn:
            self._rows.flush(layout.rows)
            return self._file.get(layout.rows)

    def add(
        self,
        layout: CameraLayout,
        measurement: Measurement,
        correction: Correction | None = None,
        *,
        elsewhere: bool = False,
    ) -> None:
        """Append the strains of an image, whose field has been appended.

        `layout`: where the file contains the images of the camera. `correction`: given for every
        image of a series, or for none. `elsewhere`: True if the corrected displacements and strains are
        stored in another group of the file. Corrected fields are not stored twice, because they take most of
        the space in the file.
        """
        with self._turn, self._room():
            group, n = self._file[layout.rows], self._next(f"{layout.rows}/strain")
            if n == 0:
                _describe_strain(group, measurement)
            for rows in _measured_rows(measurement):
                self._rows.append(group, n, rows)
            if correction is not None:
                # Strains that are not written are not computed either. Names and shapes are the same.
                strain = measurement.strain if elsewhere else None
                self._add_correction(group, n, correction, strain)

    def add_two_cameras(self, place: str, cameras: tuple[str, str], index: int, found: TwoCameraStep) -> None:
        """Append the results that two cameras give together for a step; `index` is the step's number."""
        group = self.group(place)
        group.attrs["cameras"] = list(cameras)
        n = self._next(place)
        rows = {"step": np.int64(index)} | _reason_rows(found.declined) | _mean_rows(found.mean, "mean/")
        for name in ("heights_mm", "heights_std_mm"):
            if getattr(found, name) is not None:
                rows[name] = getattr(found, name)
        self._rows.append(group, n, rows)
        for camera, correction in zip(cameras, found.corrections, strict=True):
            self._add_correction(group.require_group(camera), n, correction)

    def _next(self, place: str) -> int:
        """Return the number of the next row of the series at `place`, from 0."""
        n = self._counts.get(place, 0)
        self._counts[place] = n + 1
        return n

    def _add_correction(
        self, group: Any, n: int, correction: Correction, unwritten: StrainField | None = None
    ) -> None:
        """Write the correction of the image with the index `n` of a series.

        If `unwritten` is given, displacements and local strains get an empty row. Its arrays have the shapes.
        """
        summary, means = correction.as_dict(), group.require_group("corrected_mean")
        table = (
            _mean_rows(correction.mean) | _reason_rows(correction.declined) | {"method": correction.method}
        )
        table |= _known_rows({name: summary.get(name) for name in PLANE_KEYS})
        table[SHARED_KEY] = correction.shared_errors
        if correction.mounting is not None or self._rows.holds(means, MOUNTING_KEY):
            unknown = np.full((3, 3), np.nan)
            table[MOUNTING_KEY] = unknown if correction.mounting is None else correction.mounting
        # Leave out parts that no image of the series has.
        parts = [name for name in UNCERTAINTY_KEYS if name in summary or self._rows.holds(means, name)]
        self._rows.append(means, n, table | _known_rows({name: summary.get(name) for name in parts}))
        if correction.declined is None:
            if "corrected" not in group:
                # All images of a series have the same points, so their reference positions are stored once.
                _write_position(group.create_group("corrected"), correction.displacement)
            rows = _displacement_rows(correction.displacement)
            rows |= strain_values(correction.strain if unwritten is None else unwritten)
            self._rows.append(group["corrected"], n, rows, write=unwritten is None)


def _write_provenance(group: Any, origin: Provenance) -> None:
    import h5py

    group.attrs.update({"command": origin.command, "versions": origin.versions})
    if origin.job is not None:
        group.attrs.update({"job_fields": origin.job.fields, "job_strains": origin.job.strains})
    for name, values in (("file", origin.inputs.keys()), ("sha256", origin.inputs.values())):
        group.create_dataset(name, data=list(values), dtype=h5py.string_dtype())


def _describe_strain(group: Any, measurement: Measurement) -> None:
    """Write the values of strain that are the same for all images of a series."""
    strain = measurement.strain_settings
    group.attrs.update({f"strain_{name}": value for name, value in vars(strain).items()})
    group.attrs["strain_gauge_px"] = measurement.gauge_px
    if measurement.gauge_mm is not None:
        group.attrs["strain_gauge_mm"] = measurement.gauge_mm
    if measurement.calibrated is not None:
        _write_position(group, measurement.calibrated)


def _field_rows(image: FinishedImage, field: Field) -> Iterator[dict[str, Any]]:
    """Yield the rows of a correlated image: first the single values, then a few arrays at a time.

    Arrays that have to be computed are computed one after the other, because together they would take more
    memory than the displacements.
    """
    yield {
        "label": image.label,
        "start": field.start,
        "repetition": field.repetition,
        "sha256": image.digest,
        "smoothing_px": field.smoothing_px,
        "updates": np.uint16(field.updates),
    }
    yield {"u_px": field.u_px, "v_px": field.v_px, "zncc": field.zncc}
    yield {"gradient": field.gradient}
    yield {"std_gradient": field.std_gradient}
    yield {"std_u_px": field.std_u_px}
    yield {"std_v_px": field.std_v_px}
    yield {"noise_std_px": field.noise_std_px}
    yield {"bias_u_px": field.bias_px[..., 0], "bias_v_px": field.bias_px[..., 1]}
    yield {"status": field.status.astype(np.uint8), "iterations": field.iterations.astype(np.uint16)}
    yield {"greatest_bias_px": np.array(field.greatest_bias_px)}


def _measured_rows(measurement: Measurement) -> Iterator[dict[str, Any]]:
    """Yield the rows of the strains of an image: first the single values, then the arrays."""
    single = _mean_rows(measurement.raw_mean, "raw_mean/")
    calibrated, mean = measurement.calibrated, measurement.calibrated_mean
    if mean is not None:
        single |= _mean_rows(mean, "calibrated_mean/")
        single |= _known_rows(measurement.images_std, "calibrated_mean/")
    yield single
    yield strain_values(measurement.strain)
    if calibrated is not None and mean is not None:
        yield _displacement_rows(calibrated)
        if measurement.shared is not None:
            yield {f"calibrated_mean/{SHARED_KEY}": measurement.shared}


def _mean_rows(mean: MeanStrain | None, place: str = "") -> dict[str, Any]:
    values = dict.fromkeys(MEAN_KEYS, np.nan) | {"points": 0} if mean is None else vars(mean)
    return {f"{place}{name}": values[name] for name in MEAN_KEYS}


def _reason_rows(declined: str | None) -> dict[str, Any]:
    return {"applied": np.uint8(declined is None), "reason": declined or ""}


def _known_rows(values: Mapping[str, float | None], place: str = "") -> dict[str, float]:
    return {f"{place}{name}": np.nan if value is None else value for name, value in values.items()}


def _displacement_rows(displacement: Displacement) -> dict[str, Any]:
    vector = displacement.vector
    return {"U_mm": vector[..., 0], "V_mm": vector[..., 1], "valid": displacement.valid.astype(np.uint8)}


def _write_position(group: Any, displacement: Displacement) -> None:
    for k, axis in enumerate("XY"):
        _write(group, f"{axis}_mm", displacement.position[..., k])


def _write(group: Any, name: str, data: Any) -> None:
    group[name] = data
    group[name].attrs["units"] = units_of(name)
