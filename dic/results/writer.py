"""Writes result files in HDF5: displacements and strains of series of images.

`docs/results.md` describes the layout of the file.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from dic.errors import OutputError, RunFileError
from dic.files.writing import reason, replacing
from dic.hdf5.writing import NewFile
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.strain_parts import UNCERTAINTY_KEYS
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.results.fields import write_points
from dic.results.provenance import Provenance
from dic.results.rows import Rows
from dic.results.schema import FORMAT, MEAN_KEYS, MOUNTING_KEY, PLANE_KEYS, SHARED_KEY, VERSION, units_of
from dic.strain.displacement import Displacement
from dic.strain.measurement import Measurement
from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS, MeanStrain, StrainField


class ResultWriter:
    """A writer that appends measurements to a file one by one. The writer keeps no fields in memory.

    Parameters
    ----------
    path : Path
        The file to create. An existing file is replaced only when the new file is complete and has results.
    origin : Provenance
        Where the results come from.
    """

    def __init__(self, path: Path, origin: Provenance) -> None:
        self._path, self._origin, self._rows = path, origin, Rows()
        self._counts: dict[str, int] = {}
        self._place = ExitStack()
        try:
            self._partial = self._place.enter_context(replacing(path))
            self._new = NewFile(self._partial)
        except OSError as error:
            expected, remedy = "a folder that can be written to", "name another file"
            raise RunFileError(str(path), "create results", expected, reason(error), remedy) from error
        self._file = self._new.hdf5
        self._file.attrs.update({"file_format": FORMAT, "file_format_version": VERSION})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        empty = len(self._file) == 0
        try:
            if not empty:
                self._rows.finish()
                _write_provenance(self._file.create_group("provenance"), self._origin)
            with self._room():
                self._new.close()
        except BaseException as closing:
            self._place.__exit__(type(closing), closing, closing.__traceback__)
            raise
        if empty:
            self._partial.unlink()
        self._place.__exit__(kind, error, trace)

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

    def add(
        self,
        place: str,
        measurement: Measurement,
        correction: Correction | None = None,
        *,
        elsewhere: bool = False,
    ) -> None:
        """Append a measurement to a series; create the series if it does not exist.

        Parameters
        ----------
        place : str
            Name of the group of the file that contains the series.
        measurement : Measurement
        correction : Correction, optional
            The correction of the measurement. Give a correction for every image of a series, or for none.
        elsewhere : bool
            True if the corrected displacements and strains are stored in another group of the file. Corrected
            fields are not stored twice, because they take most of the space in the file.
        """
        with self._room():
            group = self._file.get(place)
            if group is None:
                group = _create_series(self._file.create_group(place), measurement)
            n = self._next(place)
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
            rows |= _strain_rows(correction.strain if unwritten is None else unwritten)
            self._rows.append(group["corrected"], n, rows, write=unwritten is None)


def _write_provenance(group: Any, origin: Provenance) -> None:
    import h5py

    group.attrs.update({"command": origin.command, "versions": origin.versions})
    if origin.job is not None:
        group.attrs.update({"job_fields": origin.job.fields, "job_strains": origin.job.strains})
    for name, values in (("file", origin.inputs.keys()), ("sha256", origin.inputs.values())):
        group.create_dataset(name, data=list(values), dtype=h5py.string_dtype())


def _create_series(group: Any, measurement: Measurement) -> Any:
    """Create the group of a series, and write the values that are the same for all its images."""
    group.attrs.update(vars(measurement.settings))
    strain = measurement.strain_settings
    group.attrs.update({f"strain_{name}": value for name, value in vars(strain).items()})
    group.attrs["strain_gauge_px"] = measurement.gauge_px
    if measurement.gauge_mm is not None:
        group.attrs["strain_gauge_mm"] = measurement.gauge_mm
    write_points(group, measurement.field)
    if measurement.calibrated is not None:
        _write_position(group, measurement.calibrated)
    return group


def _measured_rows(measurement: Measurement) -> Iterator[dict[str, Any]]:
    """Yield the rows of an image: first the single values, then a few arrays at a time.

    Arrays that have to be computed are computed one after the other, because together they would take more
    memory than the displacements.
    """
    field, calibrated = measurement.field, measurement.calibrated
    single: dict[str, Any] = {
        "label": measurement.label,
        "start": field.start,
        "sha256": measurement.digest,
        "smoothing_px": field.smoothing_px,
        "updates": np.uint16(field.updates),
    }
    single |= _mean_rows(measurement.raw_mean, "raw_mean/")
    if measurement.calibrated_mean is not None:
        single |= _mean_rows(measurement.calibrated_mean, "calibrated_mean/")
        single |= _known_rows(measurement.images_std, "calibrated_mean/")
    yield single
    yield {"u_px": field.u_px, "v_px": field.v_px, "zncc": field.zncc}
    yield {"gradient": field.gradient}
    yield {"std_gradient": field.std_gradient}
    yield {"std_u_px": field.std_u_px}
    yield {"std_v_px": field.std_v_px}
    yield {"noise_std_px": field.noise_std_px}
    yield {"bias_u_px": field.bias_px[..., 0], "bias_v_px": field.bias_px[..., 1]}
    yield {"status": field.status.astype(np.uint8), "iterations": field.iterations.astype(np.uint16)}
    yield {"greatest_bias_px": np.array(field.greatest_bias_px)}
    yield _strain_rows(measurement.strain)
    if calibrated is not None and measurement.calibrated_mean is not None:
        yield _displacement_rows(calibrated)
        if measurement.shared is not None:
            yield {f"calibrated_mean/{SHARED_KEY}": measurement.shared}


def _strain_rows(strain: StrainField) -> dict[str, Any]:
    parts = {name: getattr(strain, name) for name in IMAGES_KEYS}
    known = {name: part for name, part in parts.items() if part is not None}
    return {name: getattr(strain, name) for name in STRAIN_KEYS} | known


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
