"""The displacement fields that the gauges of a camera read: raw, calibrated and corrected, frame by frame.

The arrays are those of the offline measurement, with values at the points of gauges only. So gauges read them
with the same code. They are made once, and each frame writes its values into them.
"""

from dataclasses import replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.correlation.interpolation_bias import bias_at
from dic.correlation.prepared_reference import PreparedReference
from dic.correlation.status import Status
from dic.gauges.field import GaugeField
from dic.live.mapping import CalibratedArea, LocalMap
from dic.live.points import GaugePoints
from dic.live.tracking import Tracker
from dic.strain.displacement import Displacement
from dic.strain.measurement import Measurement
from dic.typing import Float, Mask

_UPWARDS = np.array([1.0, -1.0])


def reference_field(reference: PreparedReference, region: Mask) -> Field:
    """Return the displacement field of the reference itself: no point has moved."""
    grid, settings, smoothing = reference.grid, reference.settings, reference.smoothing
    shape = grid.active.shape
    status = np.where(grid.active, Status.CONVERGED, Status.NOT_REACHED).astype(np.int8)
    zeros = np.zeros((*shape, settings.parameters))
    return Field(
        grid.x, grid.y, zeros, np.zeros((*shape, 6)), np.ones(shape), np.zeros(shape, np.int16),
        status, grid.active, "previous", settings, region=region, grid=grid,
        smoothing_px=smoothing.width_px, greatest_bias_px=smoothing.bias_px,
    )  # fmt: skip


class LiveFields:
    """The displacement fields of one camera.

    `reference`: the measurement of the reference image with itself. `prepared`: the prepared reference.
    `points`: the points of the gauges. `calibration`: calibration of the camera, or None.

    `valid`, shape (n,): True for points with a displacement, inside the calibrated area. `after_px`, shape
    (n, 2): places of the points in the frame. `after_mm`, `scale`: their calibrated places, and the
    derivatives of these with respect to the places in the frame.
    """

    def __init__(
        self,
        reference: Measurement,
        prepared: PreparedReference,
        points: GaugePoints,
        calibration: Calibration | None,
    ) -> None:
        at = points.points
        self._points, self._at = points, at
        self.grid_at = points.rows[at], points.columns[at]
        self.before_px = np.column_stack([points.x[at], points.y[at]]).astype(np.float64)
        self._subset_px, smoothing = prepared.settings.subset_px, prepared.smoothing
        self._bias_px, self._std_factors = smoothing.bias_px, np.array(smoothing.std_factors)
        self.valid = np.zeros(len(at), np.bool_)
        self.after_px, self._std, self._bias = self.before_px, *np.zeros((2, len(at), 2))
        self.measure = reference.strain_settings.measure
        none = np.zeros((3, 3))
        self.raw = GaugeField(blank(reference.raw), none, none, self.measure)
        self.calibrated: GaugeField | None = None
        self._map: LocalMap | None = None
        self.area: CalibratedArea | None = None
        self._in_reference = np.ones(len(at), np.bool_)
        if calibration is not None and reference.calibrated is not None:
            unknown = np.full((3, 3), np.nan)
            self.calibrated = GaugeField(blank(reference.calibrated), none, unknown, self.measure)
            self._map, self.area = LocalMap(calibration, self.before_px), CalibratedArea(calibration)
            self._in_reference = calibration.inside(self.before_px)
            self.before_mm = reference.calibrated.position[self.grid_at]
        self.after_mm, self.scale = np.zeros((len(at), 2)), np.zeros((len(at), 2, 2))

    def take(self, tracker: Tracker) -> None:
        """Write the displacements of a frame into the raw and the calibrated field."""
        at = self._at
        warps = tracker.warps[at]
        moved = warps[:, [0, 3]]
        self.after_px = self.before_px + moved
        self.valid = tracker.known & self._in_reference
        if self.area is not None:
            self.valid &= self.area.inside(self.after_px)
        self._std = tracker.std[at][:, [0, 3]] * self._std_factors
        biases = (
            bias_at(warps[:, k], warps[:, k + 1 : k + 3], self._subset_px, greatest_px)
            for k, greatest_px in zip((0, 3), self._bias_px, strict=True)
        )
        self._bias = np.stack(list(biases), axis=-1)
        self._write(self.raw.displacement, moved * _UPWARDS, np.diag(_UPWARDS))
        if self.calibrated is not None and self._map is not None:
            self.after_mm, self.scale = self._map.at(self.after_px)
            self._write(self.calibrated.displacement, self.after_mm - self.before_mm, self.scale)

    def share(self, covariance: Float) -> None:
        """Take the covariance (3, 3) of errors of exx, eyy, exy that all calibrated displacements share."""
        if self.calibrated is not None:
            none = np.zeros((3, 3))
            self.calibrated = GaugeField(self.calibrated.displacement, none, covariance, self.measure)

    def write_corrected(self, field: GaugeField, vector: Float) -> None:
        """Write displacements (n, 2) into a corrected field, which has the noise of the calibrated one."""
        field.displacement.vector[self.grid_at] = vector
        field.displacement.valid[self.grid_at] = self.valid

    def _write(self, field: Displacement, vector: Float, there: Float) -> None:
        field.vector[self.grid_at], field.valid[self.grid_at] = vector, self.valid
        if field.noise is not None:
            field.noise.factors[self.grid_at] = there * self._std[:, None, :]
            if field.noise.bias is not None:
                field.noise.bias[self.grid_at] = there * self._bias[:, None, :]


def blank(field: Displacement) -> Displacement:
    """Return a field with the same positions, and arrays of its own for displacements and errors."""
    shape, noise = field.valid.shape, field.noise
    if noise is not None:
        zeros = np.zeros((2, *shape, 2, 2))
        noise = replace(noise, factors=zeros[0], bias=zeros[1])
    return replace(
        field,
        vector=np.full((*shape, 2), np.nan),
        valid=np.zeros(shape, np.bool_),
        gradient=None,
        noise=noise,
    )
