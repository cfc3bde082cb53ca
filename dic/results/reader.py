"""Reads result files and returns the stored values unchanged.

Files of earlier versions lack some values, for example the number of points of a mean strain. The reader
computes the missing values.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.files.lazy import Computed, ComputedMapping
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.strain_parts import UNCERTAINTY_KEYS
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.results.columns import Columns
from dic.results.fields import StoredFields, plain, read_settings
from dic.results.job import Job
from dic.results.provenance import Provenance
from dic.results.schema import MEAN_KEYS, MOUNTING_KEY, SHARED_KEY
from dic.strain.displacement import NOWHERE, Displacement, raw_displacement
from dic.strain.measurement import Measurement, measure
from dic.strain.settings import StrainSettings
from dic.strain.strain import IMAGES_KEYS, STRAIN_KEYS, MeanStrain, StrainField
from dic.typing import Float


def read_provenance(file: Any) -> Provenance | None:
    """Return where the results of an open file come from; None for files of earlier versions."""
    group = file.get("provenance")
    if group is None:
        return None
    inputs = zip(*(map(str, group[name].asstr()[:]) for name in ("file", "sha256")), strict=True)
    # Files of earlier versions lack the texts of the job.
    known = "job_fields" in group.attrs
    job = Job(str(group.attrs["job_fields"]), str(group.attrs["job_strains"])) if known else None
    return Provenance(str(group.attrs["command"]), str(group.attrs["versions"]), dict(inputs), job)


def read_measurements(
    series: Any, calibration: Calibration | None, *, local_strain: bool = True
) -> Sequence[Measurement]:
    """Return the measurements of a series, each of which is read from the open result file when it is used.

    The calibrated displacements lack gradients and errors, because result files do not store them.

    `series`: group of the file that `ResultWriter.add` wrote. `calibration`: used only if the file lacks
    values. `local_strain`: False to leave out local strains and gradients, which take most of the time of
    reading. Then the strains of the measurements must not be used.

    Raises `KeyError` or `TypeError` if the group does not contain the measurements of a series of images.
    """
    stored, strain = StoredFields(series), StrainSettings(**read_settings(series, StrainSettings, "strain_"))
    columns, gauge_px, gauge_mm = Columns(series), *_gauges(series)

    def read(k: int) -> Measurement:
        field = stored.field(k, gradients=local_strain)
        found = _read_measurement(columns, k, field, strain, calibration)
        raw = raw_displacement(field, gradients=local_strain and strain.source == "shape")
        local = _read_strain(columns, k) if local_strain else None
        return replace(found, raw=raw, stored_strain=local, gauge_px=gauge_px, gauge_mm=gauge_mm)

    return Computed(len(series["label"]), read)


def _gauges(series: Any) -> tuple[int, float | None]:
    """Return the size of the virtual strain gauge in px, and in mm for calibrated images."""
    gauge_mm = float(series.attrs["strain_gauge_mm"]) if "calibrated_mean" in series else None
    return int(series.attrs["strain_gauge_px"]), gauge_mm


def read_corrections(
    group: Any, measurements: Sequence[Measurement], anew: Sequence[Correction] | None = None
) -> Sequence[Correction]:
    """Return the corrections of a series, each of which is read from the open file when it is used.

    If the corrected values of an image are stored in another group of the file, the returned values are NaN.

    `group`: group of the file that `ResultWriter.add_corrections` wrote. `measurements`: the measurements to
    which the corrections belong. `anew`: the same corrections, computed again. Give these corrections if the
    file is of an earlier version that lacks values.
    """
    columns = Columns(group)
    return Computed(
        len(measurements),
        lambda k: _read_correction(columns, k, measurements[k], None if anew is None else anew[k]),
    )


def read_two_cameras(
    group: Any, measurements: Mapping[str, Mapping[int, Measurement]]
) -> tuple[tuple[str, str], Mapping[int, TwoCameraStep]]:
    """Return the results that two cameras give together from a result file.

    `group`: group of the file that `ResultWriter.add_two_cameras` wrote. `measurements`: the measurements,
    keyed by the camera's name and then by the step's number.

    Result: the names of the two cameras, and the result of both cameras together for each step, keyed by the
    step's number. The result of a step is read when it is used.
    """
    first, second = map(str, group.attrs["cameras"])
    indices = group["step"][:].tolist() if "step" in group else []

    def of_camera(camera: str) -> Sequence[Correction]:
        found = Computed(len(indices), lambda k: measurements[camera][indices[k]])
        return read_corrections(group[camera], found) if indices else []

    ones, others, columns = of_camera(first), of_camera(second), Columns(group)

    def read(k: int) -> TwoCameraStep:
        both, declined = (ones[k], others[k]), _read_reason(columns, k)
        if declined is not None:
            return TwoCameraStep(both, declined=declined)
        heights = columns["heights_mm"][k], columns["heights_std_mm"][k]
        return TwoCameraStep(both, _read_mean(columns["mean"], k), *heights)

    return (first, second), ComputedMapping(indices, Computed(len(indices), read))


def _read_measurement(
    series: Columns,
    k: int,
    field: Field,
    strain: StrainSettings,
    calibration: Calibration | None,
) -> Measurement:
    """Return a measurement without its gauges, raw displacements and local strains."""
    label, anew = str(series["label"][k]), None
    if "points" not in series["raw_mean"]:
        anew = measure(field, calibration, strain, label=label)
    raw_mean = _read_mean(series["raw_mean"], k, None if anew is None else anew.raw_mean)
    calibrated, calibrated_mean, by_images, shared = None, None, None, None
    if "calibrated_mean" in series:
        calibrated = _read_displacement(series, k)
        mean = None if anew is None else anew.calibrated_mean
        calibrated_mean = _read_mean(series["calibrated_mean"], k, mean)
        by_images = _read_by_images(series["calibrated_mean"], k, calibrated_mean)
        shared = _read_shared(series["calibrated_mean"], k)
    return Measurement(
        label=label,
        field=field,
        raw=NOWHERE,
        calibrated=calibrated,
        strain_settings=strain,
        gauge_px=0,
        gauge_mm=None,
        raw_mean=raw_mean,
        calibrated_mean=calibrated_mean,
        by_images=by_images,
        shared=shared,
        digest=str(series["sha256"][k]) if "sha256" in series else "",
    )


def _read_by_images(group: Columns, k: int, mean: MeanStrain) -> MeanStrain | None:
    """Return the mean strain with the standard deviations that images cause; None if these are not stored."""
    if IMAGES_KEYS[0] not in group:
        return None
    # The standard deviations of principal strains that images cause are not stored, because no caller needs
    # them.
    unknown: dict[str, Any] = {name: np.nan for name in MEAN_KEYS if name.endswith("_std")}
    parts: dict[str, Any] = {name.removesuffix("_images"): float(group[name][k]) for name in IMAGES_KEYS}
    return replace(mean, **unknown | parts)


def _read_correction(group: Columns, k: int, measurement: Measurement, anew: Correction | None) -> Correction:
    table, declined = group["corrected_mean"], _read_reason(group["corrected_mean"], k)
    displacement, strain = measurement.calibrated, measurement.stored_strain
    if declined is None and anew is not None:
        displacement, strain = anew.displacement, anew.stored_strain
    elif declined is None:
        displacement = _read_displacement(group["corrected"], k)
        strain = None if strain is None else _read_strain(group["corrected"], k)
    if displacement is None:
        raise KeyError("calibrated displacement")
    after, after_std = _read_plane(table, k)
    return Correction(
        method=str(table["method"][k]),
        mean=_read_mean(table, k, None if anew is None else anew.mean),
        displacement=displacement,
        strain_settings=measurement.strain_settings,
        after=after,
        after_std=after_std,
        declined=declined,
        stored_strain=strain,
        uncertainty=_read_uncertainty(table, k),
        shared=_read_shared(table, k) if anew is None else anew.shared,
        mounting=_read_mounting(table, k) if anew is None else anew.mounting,
    )


def _read_shared(table: Columns, k: int) -> Float | None:
    """Return the covariance of errors that are equal at all points; None for files of earlier versions."""
    return np.asarray(table[SHARED_KEY][k], np.float64) if SHARED_KEY in table else None


def _read_mounting(table: Columns, k: int) -> Float | None:
    """Return `Correction.mounting`; None for images and files without it."""
    found = np.asarray(table[MOUNTING_KEY][k], np.float64) if MOUNTING_KEY in table else np.full(1, np.nan)
    return found if np.isfinite(found).all() else None


def _read_uncertainty(table: Columns, k: int) -> dict[str, float] | None:
    """Return the parts of a corrected strain's standard deviations; None if the file does not store them."""
    values = {name: float(table[name][k]) for name in UNCERTAINTY_KEYS if name in table}
    return {name: value for name, value in values.items() if np.isfinite(value)} or None


def _read_displacement(group: Columns, k: int) -> Displacement:
    position = np.stack([group["X_mm"][:], group["Y_mm"][:]], axis=-1)
    vector = np.stack([group["U_mm"][k], group["V_mm"][k]], axis=-1)
    return Displacement(position, vector, group["valid"][k].astype(np.bool_), "mm")


def _read_strain(group: Columns, k: int) -> StrainField:
    # The parts of the standard deviations are missing in files of earlier versions and for raw strains.
    parts = {name: group[name][k] for name in IMAGES_KEYS if name in group}
    return StrainField(**{name: group[name][k] for name in STRAIN_KEYS}, **parts)


def _read_mean(group: Columns, k: int, anew: MeanStrain | None = None) -> MeanStrain:
    values: dict[str, Any] = {} if anew is None else dict(vars(anew))
    return MeanStrain(**(values | {name: plain(group[name][k]) for name in MEAN_KEYS if name in group}))


def _read_plane(table: Columns, k: int) -> tuple[Plane | None, Float | None]:
    slopes_deg = np.array([table["slope_x_deg"][k], table["slope_y_deg"][k]])
    if np.isnan(slopes_deg).any():
        return None, None
    slope_x, slope_y = np.tan(np.radians(slopes_deg)).tolist()
    std_deg = [table["slope_x_deg_std"][k], table["slope_y_deg_std"][k]]
    std = np.array([*np.radians(std_deg), table["shift_mm_std"][k]])
    return Plane(slope_x, slope_y, float(table["shift_mm"][k])), std


def _read_reason(group: Columns, k: int) -> str | None:
    return None if group["applied"][k] else str(group["reason"][k])
