"""The result file: fields and strains of whole series, HDF5, layout in `docs/results.md`."""

import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from dic.errors import RunFileError
from dic.out_of_plane.correction import Correction
from dic.strain.measurement import Measurement
from dic.strain.strain import STRAIN_KEYS

FORMAT = "offaxis-results"
VERSION = 1
CORRECTION_UNITS = {
    "slope_x_deg": "deg",
    "slope_y_deg": "deg",
    "slope_x_deg_std": "deg",
    "slope_y_deg_std": "deg",
    "shift_mm": "mm",
    "shift_mm_std": "mm",
}


class ResultWriter:
    """Writes measurements one by one, so that a long series never has to be in memory.

    Parameters
    ----------
    path : Path
        The file to create; an existing one is replaced only when the new one is complete.
    """

    def __init__(self, path: Path) -> None:
        import h5py

        self._path = path
        self._partial = path.with_name(path.name + ".partial")
        try:
            self._file = h5py.File(self._partial, "w")
        except OSError as error:
            raise RunFileError(
                str(path),
                "create results",
                "a folder that can be written to",
                os.strerror(error.errno) if error.errno else "an error of the file system",
                "name another file",
            ) from error
        self._file.attrs.update({"file_format": FORMAT, "file_format_version": VERSION})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        if kind is None:
            self._partial.replace(self._path)
        else:
            self._partial.unlink(missing_ok=True)

    def add(self, series: str, measurement: Measurement) -> None:
        """Append a measurement to a series, which its first measurement creates."""
        group = self._file.get(series)
        if group is None:
            group = self._create(series, measurement)
        n = len(group["label"])
        field = measurement.field
        rows: dict[str, Any] = {
            "label": measurement.label,
            "start": field.start,
            "u_px": field.u_px,
            "v_px": field.v_px,
            "gradient": field.gradient,
            "std_u_px": field.std_u_px,
            "std_v_px": field.std_v_px,
            "std_gradient": field.std_gradient,
            "zncc": field.zncc,
            "status": field.status,
            "iterations": field.iterations,
            "updates": field.updates,
        }
        rows |= {name: getattr(measurement.strain, name) for name in STRAIN_KEYS}
        rows |= {f"raw_mean/{name}": getattr(measurement.raw_mean, name) for name in STRAIN_KEYS}
        if measurement.calibrated is not None and measurement.calibrated_mean is not None:
            vector = measurement.calibrated.vector
            rows |= {"U_mm": vector[..., 0], "V_mm": vector[..., 1], "valid": measurement.calibrated.valid}
            mean = measurement.calibrated_mean
            rows |= {f"calibrated_mean/{name}": getattr(mean, name) for name in STRAIN_KEYS}
        for name, value in rows.items():
            dataset = group[name]
            dataset.resize(n + 1, axis=0)
            dataset[n] = value

    def add_corrections(self, series: str, corrections: Sequence[Correction]) -> None:
        """Write the corrected mean strains of a whole series, of which all measurements were added before."""
        import h5py

        group = self._file[series].create_group("corrected_mean")
        summaries = [correction.as_dict() for correction in corrections]
        for name in STRAIN_KEYS:
            group[name] = _column(summaries, name)
            group[name].attrs["units"] = _strain_units(name)
        for name, units in CORRECTION_UNITS.items():
            group[name] = _column(summaries, name)
            group[name].attrs["units"] = units
        group["applied"] = np.array([summary["applied"] for summary in summaries], np.uint8)
        group["applied"].attrs["units"] = "1"
        for name in ("method", "reason"):
            texts = [summary[name] or "" for summary in summaries]
            group.create_dataset(name, data=texts, dtype=h5py.string_dtype())

    def group(self, name: str) -> Any:
        """Return the group `name` of the open file, made if it does not exist."""
        return self._file.require_group(name)

    def _create(self, series: str, measurement: Measurement) -> Any:
        import h5py

        group = self._file.create_group(series)
        group.attrs.update(vars(measurement.settings))
        strain = measurement.strain_settings
        group.attrs.update({f"strain_{name}": value for name, value in vars(strain).items()})
        group.attrs["strain_gauge_px"] = measurement.gauge_px
        if measurement.gauge_mm is not None:
            group.attrs["strain_gauge_mm"] = measurement.gauge_mm
        field = measurement.field
        shape = field.status.shape

        def growing(name: str, units: str, dtype: Any, row: tuple[int, ...] = ()) -> None:
            dataset = group.create_dataset(
                name, (0, *row), dtype, maxshape=(None, *row), chunks=(1 if row else 256, *row)
            )
            if units:
                dataset.attrs["units"] = units

        def fixed(name: str, units: str, data: Any) -> None:
            group[name] = data
            group[name].attrs["units"] = units

        fixed("x_px", "px", field.x_px)
        fixed("y_px", "px", field.y_px)
        fixed("active", "1", field.active.astype(np.uint8))
        for name in ("label", "start"):
            growing(name, "", h5py.string_dtype())
        for name, units in (("u_px", "px"), ("v_px", "px"), ("zncc", "1")):
            growing(name, units, "f8", shape)
        growing("gradient", "1", "f8", (*shape, 4))
        growing("std_u_px", "px", "f8", shape)
        growing("std_v_px", "px", "f8", shape)
        growing("std_gradient", "1", "f8", (*shape, 4))
        growing("status", "1", "u1", shape)
        growing("iterations", "1", "u2", shape)
        growing("updates", "1", "u2")
        for name in STRAIN_KEYS:
            growing(name, _strain_units(name), "f8", shape)
            growing(f"raw_mean/{name}", _strain_units(name), "f8")
        if measurement.calibrated is not None:
            fixed("X_mm", "mm", measurement.calibrated.position[..., 0])
            fixed("Y_mm", "mm", measurement.calibrated.position[..., 1])
            growing("U_mm", "mm", "f8", shape)
            growing("V_mm", "mm", "f8", shape)
            growing("valid", "1", "u1", shape)
            for name in STRAIN_KEYS:
                growing(f"calibrated_mean/{name}", _strain_units(name), "f8")
        return group


def _column(summaries: Sequence[dict[str, Any]], name: str) -> Any:
    values = [summary.get(name) for summary in summaries]
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _strain_units(name: str) -> str:
    return "deg" if name.startswith("direction_deg") else "1"
