"""Join the record of a testing machine to images, and form the curve of a tensile test from gauges."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dic.derived.image_clock import ImageClock
from dic.errors import CurveError, GaugeError
from dic.gauges.channel import MEASURED
from dic.gauges.reading import Reading, SharedPart
from dic.gauges.series import GaugeImage, GaugeSeries
from dic.gauges.strains import covariance_along
from dic.properties.curve import Curve
from dic.properties.properties import Properties
from dic.properties.shared_error import (
    JoinError,
    with_delay_error,
    with_join_error,
    with_shared_error,
)
from dic.records.joining import JOINS, JoinedRecord, join_by_name, join_by_row, join_by_time
from dic.records.machine import MachineRecord
from dic.typing import Float, Mask

_COPIED = 0.03
"""Images of a test span more than this part of the machine's record. Copies of their files span less."""


def join_record(
    series: GaugeSeries,
    record: MachineRecord,
    join: str,
    *,
    clock: ImageClock | None = None,
    gauge: str | None = None,
) -> tuple[GaugeSeries, JoinedRecord]:
    """Give each image of a series the load, displacement and time of a testing machine's record.

    Parameters
    ----------
    series : GaugeSeries
        Readings of a series of images. A run is refused, because its steps have a load already.
    record : MachineRecord
        The record from `read_machine_record`.
    join : str
        "name" (the record names the images), "row" (the lines of the record belong to the images in order) or
        "time" (the time joins lines and images).
    clock : ImageClock, optional
        The images' times; needed for "time".
    gauge : str, optional
        The gauge whose strain is compared with the load to find offset or rate. Default: the first one that
        is neither a transverse extensometer nor a cut.

    Returns
    -------
    GaugeSeries
        The series with load_n, displacement_mm and time_s in `GaugeImage.known`, and with `joined`.
    JoinedRecord

    Raises
    ------
    CurveError, GaugeError
        If the record does not fit the images.
    """
    labels = [image.label for image in series.images]
    _require_joinable(series, record, join)
    if join == "name":
        joined = join_by_name(record, labels)
    elif join == "row":
        joined = join_by_row(record, labels)
    else:
        clock = clock or ImageClock()
        times_s, source = clock.of(series.images, series.reference)
        if source == "file":
            _require_own_times(record, times_s)
        along = gauge or next((one.name for one in series.gauges if one.is_axial), None)
        strain = series.strain(along)[0] if along is not None and series.kinds else None
        if strain is None and (clock.offset_s is None or clock.clock_rate is None):
            raise _no_gauge_along(series, record)
        joined = join_by_time(record, labels, times_s, clock.machine_clock(times_s), strain)
        lost = clock.lost(series.images, times_s, strain, series.reference)
        joined = replace(joined, image_times=source, lost=lost)
    # The machine's time replaces the image's time.
    own = {"time_s", "time_source"} if joined.time_s is not None else set()
    images = tuple(
        replace(image, known={name: image.known[name] for name in image.known if name not in own} | reading)
        for image, reading in zip(series.images, map(joined.reading, range(len(labels))), strict=True)
    )
    return replace(series, images=images, joined=joined), joined


def _require_own_times(record: MachineRecord, times_s: Float) -> None:
    """Raise an error if the times of the image files' last change are probably those of a copy.

    Raises `CurveError` if the images span a small part of the machine's record.
    """
    span_s = float(np.ptp(times_s))
    whole_s = 0.0 if record.time_s is None else float(np.ptp(record.time_s))
    if len(times_s) > 1 and span_s < _COPIED * whole_s:
        expected = (
            f"image files whose last changes span at least {_COPIED * whole_s:.3g} s of the {whole_s:.6g} s"
        )
        remedy = "give --image-interval-s, or --image-times with a table: copying files changes their times"
        raise record.wrong("join by time", expected, f"{span_s:.3g} s", remedy)


@dataclass(frozen=True)
class GaugeCurve:
    """The curve of a tensile test from gauges, and the error of the strain that is common to all points.

    Attributes
    ----------
    curve : Curve
        Load and engineering strain at each image that has a reading, and the loads after the last reading.
        `Curve.passed_n` has the loads of other images without a reading.
    shared_std : ndarray, shape (n,)
        Standard deviation of the strain due to the calibration and to motion out of the plane, without the
        errors in `followed`; NaN if it is not known.
    shared_transverse : ndarray, shape (n, 2), or None
        The error of the transverse strain. The first column is the change of the transverse strain, with its
        sign, when the error of the axial strain is one standard deviation. The second column is the standard
        deviation of the independent part. None without a transverse gauge.
    followed : ndarray, shape (n, 2, causes)
        Errors of the axial and the transverse strain that follow the measured motion, because their causes
        are the same in all images: the mounting of the specimen. Each cause differs by one standard deviation
        from its expected value. The transverse errors are 0 without a transverse gauge.
    kind : str
        "raw", "calibrated" or "corrected".
    left_out : int
        Number of images without a reading.
    labels : tuple of str
        The image or the run's step of each point, shape (n,).
    joined : JoinError or None
        The errors of the loads by the machine's clock; None if they were not joined by time.
    lag_n : ndarray, shape (n,), or None
        Change of the load at each point if all images were taken later by one standard deviation of the
        delays; None if the loads do not come from a run.
    lag_strain : ndarray, shape (n,), or None
        The same for the strain of a channel; None for a gauge in the images.
    """

    curve: Curve
    shared_std: Float
    shared_transverse: Float | None
    followed: Float
    kind: str
    left_out: int
    labels: tuple[str, ...]
    joined: JoinError | None = None
    lag_n: Float | None = None
    lag_strain: Float | None = None

    def judged(self, found: Properties) -> Properties:
        """Return the properties of this curve with deviations that contain all errors of this curve."""
        found = with_shared_error(found, self.shared_std, self.shared_transverse, self.followed)
        if self.lag_n is not None:
            found = with_delay_error(found, self.lag_n, self.lag_strain)
        return found if self.joined is None else with_join_error(found, self.joined)


def gauge_curve(
    series: GaugeSeries,
    gauge: str,
    transverse: str | None = None,
    *,
    kind: str | None = None,
    camera: str | None = None,
) -> GaugeCurve:
    """Return load against the strain of a gauge, for `material_properties`.

    Parameters
    ----------
    series : GaugeSeries
        A series with the load of each image. The load comes from a run file, or from `join_record`.
    gauge : str
        Name of the gauge along the specimen, or of a channel in a unit of strain, such as "channels.clip".
    transverse : str, optional
        Name of the gauge across the specimen.
    kind : str, optional
        "raw", "calibrated" or "corrected". Default: the best kind that any image has.
    camera : str, optional
        Camera of a run; needed if the series has readings of several cameras.

    Raises
    ------
    CurveError, GaugeError
        If a gauge or a kind is unknown, there is no load, or this is not the curve of a tensile test.
    """
    source = series.source or "gauges"
    series = _of_camera(series, camera)
    chosen = kind or series.kinds[0] if series.kinds else "raw"
    channel, known = series.channels.get(gauge), [image.known for image in series.images]
    strain = series.strain(gauge, chosen)[0] if channel is None else channel.strain(known)
    across = None if transverse is None else series.strain(transverse, chosen)[0]
    if not any("load_n" in each for each in known):
        remedy = "give the machine's record with --record"
        raise CurveError(source, "load", "a load for each image", "none", remedy)
    load_n = np.array([float(each.get("load_n", np.nan)) for each in known])
    read = np.isfinite(strain) & np.isfinite(load_n)
    last = int(np.flatnonzero(read)[-1]) if read.any() else len(read)
    # Keep the loads of images after the last reading, because the largest load may be among them.
    use = read | (np.isfinite(load_n) & (np.arange(len(read)) > last))
    time_s = np.array([float(each.get("time_s", np.nan)) for each in known])[use]
    curve = Curve(
        source,
        load_n[use],
        strain[use],
        None if across is None else across[use],
        time_s if np.isfinite(time_s).all() else None,
        _passed(load_n, use),
        _own_std_n(known, use),
    )
    followed = _followed(series, gauge, transverse, chosen)
    # For raw strain, only the errors that the images cause are known; for a channel, only those of its time.
    shared = np.full(len(use), np.nan)
    if chosen != "raw" and channel is None:
        shared = _shared_std(series, gauge, chosen, followed)
    beside = None
    if transverse is not None:
        beside = _shared_transverse(series, gauge, transverse, chosen, followed)[use]
    labels = tuple(str(image.known.get("step", image.label)) for image in series.images)
    kept = tuple(label for label, used in zip(labels, use, strict=True) if used)
    left_out = int(np.count_nonzero(~read))
    joined = None
    if series.joined is not None and series.joined.errors_n is not None and series.joined.clock is not None:
        joined = JoinError(series.joined.errors_n[use], series.joined.clock.correlation)
    return GaugeCurve(
        curve,
        shared[use],
        beside,
        followed[use],
        chosen if channel is None else MEASURED,
        left_out,
        kept,
        joined,
        _lag_n(known, use),
        None if channel is None else channel.lag(known)[use],
    )


def _lag_n(known: Sequence[Mapping[str, Any]], use: Mask) -> Float | None:
    """Return `GaugeCurve.lag_n`; the change is 0 at images where it is not known."""
    found = np.array([float(each.get("load_lag_n", np.nan)) for each in known])[use]
    return np.nan_to_num(found) if np.isfinite(found).any() else None


def _own_std_n(known: Sequence[Mapping[str, Any]], use: Mask) -> Float | None:
    """Return `Curve.load_std_n`, which lacks the part that all images share; None if no load states it."""
    std, lag = (
        np.array([float(each.get(name, np.nan)) for each in known])[use]
        for name in ("load_std_n", "load_lag_n")
    )
    own = np.sqrt(np.maximum(std**2 - np.nan_to_num(lag) ** 2, 0.0))
    return own if np.isfinite(own).any() else None


def _passed(load_n: Float, use: Mask) -> Float | None:
    """Return `Curve.passed_n` for the images where `use` is True; None if no other image has a load."""
    passed = np.full((np.count_nonzero(use), 2), np.nan)
    for k in np.flatnonzero(~use & np.isfinite(load_n)):
        point = int(np.count_nonzero(use[:k]))
        if point < len(passed):
            passed[point] = np.fmin(passed[point, 0], load_n[k]), np.fmax(passed[point, 1], load_n[k])
    return passed if np.isfinite(passed).any() else None


def _followed(series: GaugeSeries, gauge: str, transverse: str | None, kind: str) -> Float:
    """Return `GaugeCurve.followed` for all images; NaN for images without a reading."""
    pairs = [
        [
            _shared_part(image, gauge, kind),
            None if transverse is None else _shared_part(image, transverse, kind),
        ]
        for image in series.images
    ]
    causes = {part.mounting.shape[1] for pair in pairs for part in pair if part is not None}
    # If some images do not know their mounting's errors, all these errors stay in the other part.
    found = np.full((len(pairs), 2, causes.pop() if len(causes) == 1 else 0), np.nan)
    for k, pair in enumerate(pairs):
        for row, part in enumerate(pair):
            if part is not None:
                found[k, row] = part.weights @ part.mounting if found.shape[2] else 0.0
    if transverse is None:
        found[:, 1] = 0.0
    return found


def _shared_part(image: GaugeImage, gauge: str, kind: str) -> SharedPart | None:
    reading = image.readings.get(gauge, {}).get(kind)
    return reading.shared if isinstance(reading, Reading) else None


def _shared_std(series: GaugeSeries, gauge: str, kind: str, followed: Float) -> Float:
    found = [image.readings.get(gauge, {}).get(kind) for image in series.images]
    stds = [
        (one.strain_std, one.strain_std_images) if isinstance(one, Reading) else (np.nan, np.nan)
        for one in found
    ]
    whole, images = np.array(stds).reshape(-1, 2).T
    counted = np.nan_to_num((followed[:, 0] ** 2).sum(axis=1))
    return np.asarray(np.sqrt(np.maximum(whole**2 - images**2 - counted, 0.0)))


def _shared_transverse(series: GaugeSeries, gauge: str, transverse: str, kind: str, followed: Float) -> Float:
    """Return `GaugeCurve.shared_transverse` for all images, shape (images, 2); NaN if it is not known."""
    found = np.full((len(series.images), 2), np.nan)
    for k, image in enumerate(series.images):
        own, across = (_shared_part(image, name, kind) for name in (gauge, transverse))
        if own is None or across is None:
            # If the covariance of both errors is not known, they count as independent.
            reading = image.readings.get(transverse, {}).get(kind)
            if isinstance(reading, Reading):
                whole, images = reading.strain_std, reading.strain_std_images
                found[k] = 0.0, np.sqrt(max(whole**2 - images**2, 0.0))
            continue
        counted = np.nan_to_num(followed[k] @ followed[k].T)
        variance, both, other = (
            covariance_along(own.covariance, one, two) - part
            for one, two, part in (
                (own.weights, own.weights, counted[0, 0]),
                (own.weights, across.weights, counted[0, 1]),
                (across.weights, across.weights, counted[1, 1]),
            )
        )
        with_strain = both / np.sqrt(variance) if variance > 0.0 else 0.0
        found[k] = with_strain, np.sqrt(max(other - with_strain**2, 0.0))
    return found


def _of_camera(series: GaugeSeries, camera: str | None) -> GaugeSeries:
    names = sorted({str(image.known["camera"]) for image in series.images if "camera" in image.known})
    if camera is None and len(names) > 1:
        expected = f"one of {', '.join(names)}"
        raise GaugeError(series.source, "choose a camera", expected, "none", f"give --camera {names[0]}")
    kept = [image for image in series.images if camera is None or image.known.get("camera") == camera]
    return replace(series, images=tuple(kept))


def _require_joinable(series: GaugeSeries, record: MachineRecord, join: str) -> None:
    if join not in JOINS:
        raise CurveError("settings", "--join", f"one of {', '.join(JOINS)}", repr(join), "give --join row")
    if any("step" in image.known for image in series.images):
        expected, remedy = "results of `dic correlate`", "leave out the record: a run has its own load"
        raise record.wrong("join to images", expected, "results of a run", remedy)
    failed = [image.label for image in series.images if image.failure is not None]
    if join != "name" and failed and not series.in_order:
        expected, got = "images that were all measured", f"{len(failed)} that were not, such as {failed[0]}"
        remedy = "join by name, with --image-column, or correlate again with this version"
        raise record.wrong(f"join by {join}", expected, got, remedy)


def _no_gauge_along(series: GaugeSeries, record: MachineRecord) -> CurveError:
    """Return the error that no gauge has a strain that can rise with the load."""
    expected = "an extensometer, an area or a point along the specimen"
    got = f"{', '.join(sorted({gauge.kind for gauge in series.gauges}))} only"
    remedy = "declare such a gauge, or give the offset with --offset-s"
    return record.wrong("find the offset", expected, got, remedy)
