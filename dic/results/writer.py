"""The writer of result files: displacements and strains of series of images, in HDF5.

`docs/results.md` describes the layout of the file.
"""

import os
from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from dic.errors import RunFileError
from dic.files.writing import replacing
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.strain_parts import UNCERTAINTY_KEYS
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.results.schema import FORMAT, MEAN_KEYS, PLANE_UNITS, VERSION, strain_units
from dic.strain.displacement import Displacement
from dic.strain.measurement import Measurement
from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS, MeanStrain, StrainField


class ResultWriter:
    """A writer that appends measurements to a file one by one. A long series need not fit into memory.

    Parameters
    ----------
    path : Path
        The file to create. An existing file is replaced only when the new file is complete and holds results.
    """

    def __init__(self, path: Path) -> None:
        import h5py

        self._place = ExitStack()
        try:
            self._partial = self._place.enter_context(replacing(path))
            self._file = h5py.File(self._partial, "w")
        except OSError as error:
            raise RunFileError(
                str(path),
                "create results",
                "a folder that can be written to",
                error.strerror
                or (os.strerror(error.errno) if error.errno else "an error of the file system"),
                "name another file",
            ) from error
        self._file.attrs.update({"file_format": FORMAT, "file_format_version": VERSION})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        empty = len(self._file) == 0
        try:
            self._file.close()
        except BaseException as closing:
            self._place.__exit__(type(closing), closing, closing.__traceback__)
            raise
        if empty:
            self._partial.unlink()
        self._place.__exit__(kind, error, trace)

    def group(self, name: str) -> Any:
        """Return the group `name` of the open file; create the group if it does not exist."""
        return self._file.require_group(name)

    def add(self, series: str, measurement: Measurement, place: int | None = None) -> None:
        """Append a measurement to the group `series` of the file; create this group if it does not exist.

        If `place` is given, the measurement replaces the one with this index.
        """
        group = self._file.get(series)
        if group is None:
            group = _create_series(self._file.create_group(series), measurement)
        field, calibrated = measurement.field, measurement.calibrated
        rows: dict[str, Any] = {
            "label": measurement.label,
            "start": field.start,
            "u_px": field.u_px,
            "v_px": field.v_px,
            "gradient": field.gradient,
            "std_u_px": field.std_u_px,
            "std_v_px": field.std_v_px,
            "std_gradient": field.std_gradient,
            "bias_u_px": field.bias_px[..., 0],
            "bias_v_px": field.bias_px[..., 1],
            "smoothing_px": field.smoothing_px,
            "greatest_bias_px": field.greatest_bias_px,
            "zncc": field.zncc,
            "status": field.status,
            "iterations": field.iterations,
            "updates": field.updates,
        }
        rows |= _strain_rows(measurement.strain) | _mean_rows(measurement.raw_mean, "raw_mean/")
        if calibrated is not None and measurement.calibrated_mean is not None:
            rows |= _displacement_rows(calibrated)
            rows |= _mean_rows(measurement.calibrated_mean, "calibrated_mean/")
            parts = measurement.images_std.items()
            rows |= {f"calibrated_mean/{name}": np.nan if v is None else v for name, v in parts}
        n = len(group["label"]) if place is None else place
        for name, value in rows.items():
            dataset = group[name]
            if place is None:
                dataset.resize(n + 1, axis=0)
            dataset[n] = value

    def add_corrections(
        self, place: str, corrections: Sequence[Correction], elsewhere: Collection[int] = ()
    ) -> None:
        """Write the corrections of all images of a series.

        Parameters
        ----------
        place : str
            Name of the group of the file that receives the corrections.
        corrections : sequence of Correction
            The corrections in the order of the images.
        elsewhere : collection of int
            Indices of the images whose corrected displacements and strains are stored in another group.
            Corrected displacements and strains are not stored twice, because they take most of the space in
            the file.
        """
        group = self._file.require_group(place)
        _write_correction_table(group.create_group("corrected_mean"), corrections)
        applied = [k for k, correction in enumerate(corrections) if correction.declined is None]
        if not applied:
            return
        local = group.create_group("corrected")
        # All images of a series have the same points, so their reference positions are stored once.
        position = corrections[applied[0]].displacement.position
        _create_displacement(local, position, len(corrections))
        _create_strain(local, position.shape[:2], len(corrections), strain=corrections[applied[0]].strain)
        for k in sorted({*applied} - {*elsewhere}):
            rows = _displacement_rows(corrections[k].displacement) | _strain_rows(corrections[k].strain)
            for name, value in rows.items():
                local[name][k] = value

    def add_two_cameras(self, place: str, cameras: tuple[str, str], steps: dict[int, TwoCameraStep]) -> None:
        """Write the results that two cameras give together into the group `place`.

        The dict `steps` holds the result of both cameras together for each step, keyed by the step's number.
        """
        group, found = self._file.require_group(place), list(steps.values())
        group.attrs["cameras"] = list(cameras)
        _write(group, "step", "1", np.array(list(steps), np.int64))
        _write_means(group.create_group("mean"), [step.mean for step in found])
        _write_reasons(group, [step.declined for step in found])
        maps = [step.heights_mm for step in found if step.heights_mm is not None]
        for name in ("heights_mm", "heights_std_mm") if maps else ():
            dataset = _rows(group, name, "mm", maps[0].shape, len(found))
            for k, step in enumerate(found):
                if getattr(step, name) is not None:
                    dataset[k] = getattr(step, name)
        for k, camera in enumerate(cameras):
            self.add_corrections(f"{place}/{camera}", [step.corrections[k] for step in found])


def _create_series(group: Any, measurement: Measurement) -> Any:
    """Write the values that all images of a series share; create empty datasets for the other values."""
    import h5py

    group.attrs.update(vars(measurement.settings))
    strain = measurement.strain_settings
    group.attrs.update({f"strain_{name}": value for name, value in vars(strain).items()})
    group.attrs["strain_gauge_px"] = measurement.gauge_px
    if measurement.gauge_mm is not None:
        group.attrs["strain_gauge_mm"] = measurement.gauge_mm
    field = measurement.field
    shape = field.status.shape
    _write(group, "x_px", "px", field.x_px)
    _write(group, "y_px", "px", field.y_px)
    _write(group, "active", "1", field.active.astype(np.uint8))
    for name in ("label", "start"):
        _rows(group, name, "", dtype=h5py.string_dtype())
    for name, units in (("u_px", "px"), ("v_px", "px"), ("zncc", "1")):
        _rows(group, name, units, shape)
    _rows(group, "gradient", "1", (*shape, 4))
    _rows(group, "std_u_px", "px", shape)
    _rows(group, "std_v_px", "px", shape)
    _rows(group, "std_gradient", "1", (*shape, 4))
    _rows(group, "bias_u_px", "px", shape)
    _rows(group, "bias_v_px", "px", shape)
    _rows(group, "smoothing_px", "px")
    _rows(group, "greatest_bias_px", "px", (2,))
    _rows(group, "status", "1", shape, dtype="u1")
    _rows(group, "iterations", "1", shape, dtype="u2")
    _rows(group, "updates", "1", dtype="u2")
    _create_strain(group, shape, strain=measurement.strain)
    _create_means(group.create_group("raw_mean"))
    if measurement.calibrated is not None:
        _create_displacement(group, measurement.calibrated.position)
        mean = group.create_group("calibrated_mean")
        _create_means(mean)
        for name in measurement.images_std:
            _rows(mean, name, strain_units(name))
    return group


def _create_strain(group: Any, shape: tuple[int, ...], n: int = 0, *, strain: StrainField) -> None:
    for name in _strain_rows(strain):
        _rows(group, name, strain_units(name), shape, n)


def _create_displacement(group: Any, position: Any, n: int = 0) -> None:
    for k, axis in enumerate("XY"):
        _write(group, f"{axis}_mm", "mm", position[..., k])
    for name in ("U_mm", "V_mm"):
        _rows(group, name, "mm", position.shape[:2], n)
    _rows(group, "valid", "1", position.shape[:2], n, "u1")


def _create_means(group: Any) -> None:
    for name in MEAN_KEYS:
        _rows(group, name, strain_units(name), dtype="i8" if name == "points" else "f8")


def _strain_rows(strain: StrainField) -> dict[str, Any]:
    parts = {name: getattr(strain, name) for name in IMAGES_KEYS}
    known = {name: part for name, part in parts.items() if part is not None}
    return {name: getattr(strain, name) for name in STRAIN_KEYS} | known


def _mean_rows(mean: MeanStrain, place: str) -> dict[str, Any]:
    return {f"{place}{name}": getattr(mean, name) for name in MEAN_KEYS}


def _displacement_rows(displacement: Displacement) -> dict[str, Any]:
    vector = displacement.vector
    return {"U_mm": vector[..., 0], "V_mm": vector[..., 1], "valid": displacement.valid}


def _write_correction_table(group: Any, corrections: Sequence[Correction]) -> None:
    import h5py

    _write_means(group, [correction.mean for correction in corrections])
    summaries = [correction.as_dict() for correction in corrections]
    for name, units in PLANE_UNITS.items():
        values = [summary.get(name) for summary in summaries]
        _write(group, name, units, np.array([np.nan if v is None else v for v in values], np.float64))
    for name in UNCERTAINTY_KEYS:
        values = [summary.get(name) for summary in summaries]
        if any(value is not None for value in values):
            _write(group, name, "1", np.array([np.nan if v is None else v for v in values], np.float64))
    methods = [correction.method for correction in corrections]
    group.create_dataset("method", data=methods, dtype=h5py.string_dtype())
    _write_reasons(group, [correction.declined for correction in corrections])


def _write_means(group: Any, means: Sequence[MeanStrain | None]) -> None:
    for name in MEAN_KEYS:
        dtype, unknown = (np.int64, 0) if name == "points" else (np.float64, np.nan)
        values = [unknown if mean is None else getattr(mean, name) for mean in means]
        _write(group, name, strain_units(name), np.array(values, dtype))


def _write_reasons(group: Any, declined: Iterable[str | None]) -> None:
    import h5py

    reasons = list(declined)
    _write(group, "applied", "1", np.array([reason is None for reason in reasons], np.uint8))
    group.create_dataset("reason", data=[reason or "" for reason in reasons], dtype=h5py.string_dtype())


def _write(group: Any, name: str, units: str, data: Any) -> None:
    group[name] = data
    group[name].attrs["units"] = units


def _rows(
    group: Any, name: str, units: str, shape: tuple[int, ...] = (), n: int = 0, dtype: Any = "f8"
) -> Any:
    """Create a dataset of `n` rows, to which more rows can be added.

    Rows of numbers of type "f8" are NaN until they are written. Unwritten rows take no space in the file.
    """
    dataset = group.create_dataset(
        name,
        (n, *shape),
        dtype,
        maxshape=(None, *shape),
        chunks=(1 if shape else 256, *shape),
        fillvalue=np.nan if dtype == "f8" else None,
    )
    if units:
        dataset.attrs["units"] = units
    return dataset
