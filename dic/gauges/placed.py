"""Gauges with their measured points: the points are found once in the reference, and read in each image."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dic.calibration.calibration import Calibration
from dic.errors import GaugeError, all_of
from dic.gauges.declared import Gauge, Placed
from dic.gauges.field import fields_of
from dic.gauges.file import require_names
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Profile, Reading
from dic.out_of_plane.correction import Correction
from dic.strain.displacement import sight_of
from dic.strain.measurement import Measurement
from dic.typing import Float

Readings = Mapping[str, Mapping[str, Reading | Profile]]
"""Readings in one image, keyed by the gauge's name, then by kind: "raw", "calibrated" or "corrected"."""


@dataclass(frozen=True)
class PlacedGauges:
    """Gauges with the measured points that each gauge uses, for all images of a series."""

    gauges: Sequence[Gauge]
    placed: Sequence[Placed]
    """The points of each gauge."""
    calibration: Calibration | None

    def __repr__(self) -> str:
        return f"PlacedGauges({', '.join(gauge.name for gauge in self.gauges)})"

    @classmethod
    def of(
        cls,
        gauges: Sequence[Gauge],
        measurement: Measurement,
        calibration: Calibration | None,
        image_shape: tuple[int, ...],
    ) -> "PlacedGauges":
        """Find the points of each gauge in the reference.

        `measurement`: the measurement of any image of the series. `calibration`: the calibration of the
        camera; measurements that were read from a file need it. `image_shape`: height and width of the
        images, px.

        Raises `GaugeError` if a gauge lies outside the image or where no points were measured, or is declared
        in mm without a calibration. The message names all such gauges together.
        """
        require_names(gauges)
        field, calibrated = measurement.field, measurement.calibrated
        sight = sight_of(field)
        places = {"px": GridPlaces.of(measurement.raw.position, field.active, sight)}
        if calibrated is not None and any(gauge.unit == "mm" for gauge in gauges):
            inside = np.ones_like(field.active)
            if calibration is not None:
                inside = calibration.inside(field.points).reshape(inside.shape)
            places["mm"] = GridPlaces.of(calibrated.position, field.active & inside, sight)

        def placed(gauge: Gauge) -> Placed:
            _require_unit(gauge, calibrated is not None)
            gauge.require_inside(image_shape)
            return gauge.placed(places[gauge.unit], measurement.strain_settings.window_points)

        return cls(tuple(gauges), tuple(all_of(*(partial(placed, gauge) for gauge in gauges))), calibration)

    def read(self, measurement: Measurement, correction: Correction | None) -> Readings:
        """Return the readings of all gauges in one image."""
        fields = fields_of(measurement, correction, self.calibration)
        return {
            gauge.name: {kind: placed.read(field) for kind, field in fields.items()}
            for gauge, placed in zip(self.gauges, self.placed, strict=True)
        }

    def points_of(self, measurement: Measurement) -> list[Float]:
        """Return the points of each gauge in image pixels (x, y), each of shape (n, 2)."""
        field = measurement.field
        found = []
        for placed in self.placed:
            rows, columns = placed.points()
            points = np.column_stack([field.x_px[columns], field.y_px[rows]])
            found.append(np.unique(points, axis=0).astype(np.float64))
        return found


def _require_unit(gauge: Gauge, calibrated: bool) -> None:
    if gauge.unit == "mm" and not calibrated:
        raise GaugeError(
            f"gauge {gauge.name!r}",
            "find its place",
            "a calibration, because the gauge is in millimetres",
            "results without one",
            'give the gauge in pixels, with unit = "px", or correlate with --calibration',
        )
