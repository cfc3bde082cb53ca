"""Gauges over the whole measured field, for a test without declared gauges."""

import numpy as np

from dic.errors import GaugeError
from dic.gauges.kinds import StrainGauge
from dic.pipeline.result_file import Loaded, Results, with_results
from dic.strain.measurement import Measurement
from dic.typing import Float

_ROOM = 1e-6
"""The gauge extends beyond the outermost points by this fraction of the field's size."""


def whole_field_gauges(results: Results) -> tuple[StrainGauge, StrainGauge]:
    """Return two gauges over all measured points: "along", upwards in the image, and "across".

    In a run of several cameras, the gauges cover the part of the specimen that all cameras measured, in mm.

    Parameters
    ----------
    results : path, MeasuredSeries, SeriesResult or RunResult
        As for `measure_gauges`.

    Raises
    ------
    GaugeError
        If no image could be measured, or the cameras measured no common part.
    RunFileError
        If the result file cannot be read.
    """
    return with_results(results, _gauges_over)


def _gauges_over(results: Loaded) -> tuple[StrainGauge, StrainGauge]:
    views = results.views
    unit, box = ("mm", _box_mm) if views[0].camera else ("px", _box_px)
    first = (
        next((image.measurement for image in view.series.images if image.measurement is not None), None)
        for view in views
    )
    boxes = [box(measurement) for measurement in first if measurement is not None]
    low = np.max([box[0] for box in boxes], axis=0) if boxes else np.zeros(2)
    high = np.min([box[1] for box in boxes], axis=0) if boxes else np.zeros(2)
    if not (high > low).all():
        expected, remedy = "points that all cameras measured", "declare gauges with --declare"
        raise GaugeError("gauges", "cover the field", expected, "none", remedy)
    centre, size = (low + high) / 2.0, (high - low) * (1.0 + _ROOM)
    along, across = (
        StrainGauge(
            name=name,
            unit=unit,
            centre=(float(centre[0]), float(centre[1])),
            size=(float(size[0]), float(size[1])),
            direction_deg=direction,
        )
        for name, direction in (("along", 90.0), ("across", 0.0))
    )
    return along, across


def _box_px(measurement: Measurement) -> tuple[Float, Float]:
    points = measurement.raw.position[measurement.field.active]
    return _box(points * (1.0, -1.0))  # gauges in pixels count y downwards


def _box_mm(measurement: Measurement) -> tuple[Float, Float]:
    calibrated = measurement.calibrated
    if calibrated is None:
        expected, remedy = "a calibrated measurement", "measure the run with its grid images"
        raise GaugeError("gauges", "cover the field", expected, "one in pixels", remedy)
    return _box(calibrated.position[calibrated.valid])


def _box(points: Float) -> tuple[Float, Float]:
    """Return the lowest and the highest coordinates of points (n, 2)."""
    return points.min(axis=0), points.max(axis=0)
