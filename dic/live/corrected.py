"""The corrected displacements of a camera's points: within the surface of a specimen that left the plane."""

from dataclasses import replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.gauges.field import GaugeField
from dic.live.fields import LiveFields, blank
from dic.live.mapping import LocalMap
from dic.live.motion import Bend, SharedErrors
from dic.out_of_plane.correction import correcting
from dic.out_of_plane.plane import Plane
from dic.strain.fit import slopes_of
from dic.strain.measurement import Measurement
from dic.strain.tensor import strain_by_gradient
from dic.typing import Float

_POINTS_OF_A_PLANE = 3

_STEPS = np.array([1e-5, 1e-5, 1e-3, *[1e-6] * 3, *[1e-5] * 2, 1e-3])
"""Steps in the values of a motion for numerical derivatives."""


class CorrectedField:
    """The corrected field of one camera.

    `reference`: the measurement of the reference with itself. `calibration`: calibration of the camera, with
    a pinhole model. `surface`: plane of the surface in the reference; displacements are along this plane.
    `centre_mm`, shape (3,): the camera's centre in the grid's axes, if it is known better than from the
    calibration.

    `before_mm`, `after_mm`, shape (n, 2): places of the points along the surface of the reference, in the
    reference and in the frame. `centre_mm`, shape (3,): the camera's centre in the axes of the surface.
    """

    def __init__(
        self,
        fields: LiveFields,
        reference: Measurement,
        calibration: Calibration,
        surface: Plane | None = None,
        centre_mm: Float | None = None,
    ) -> None:
        best = correcting(calibration)
        if best.pinhole is None or fields.calibrated is None:
            raise ValueError("this calibration knows no camera centre")
        self._fields, self._surface = fields, surface or Plane()
        self._grid_centre_mm = best.pinhole.centre_mm if centre_mm is None else centre_mm
        self.centre_mm = self._surface.to_axes(self._grid_centre_mm)
        same = calibration.model == best.model
        self._map = None if same else LocalMap(best, fields.before_px)
        field = fields.calibrated.displacement
        position = field.position
        if not same:
            position = best.map(reference.field.points).reshape(position.shape)
        if surface is not None:
            position = surface.within(position, self._grid_centre_mm)
        # The errors are those of calibrated displacements, as offline.
        self._displacement = replace(blank(replace(field, noise=None)), position=position, noise=field.noise)
        self.before_mm = position[fields.grid_at]
        self.after_mm = self.before_mm
        self._measure = fields.measure
        self._moves = surface is not None

    def take(self) -> None:
        """Compute the places of the points of a frame along the surface of the reference."""
        after_mm = self._fields.after_mm
        if self._map is not None:
            after_mm, _ = self._map.at(self._fields.after_px)
        self.after_mm = self._surface.within(after_mm, self._grid_centre_mm) if self._moves else after_mm

    def vector(self, values: Float) -> Float:
        """Return the displacements (n, 2) within the surface if it moved as these values (9,) tell."""
        after_mm, centre_mm = self.after_mm, self.centre_mm
        plane, bend = Plane(*values[:3].tolist()), Bend(values[3:])
        moved = plane.within(after_mm, centre_mm) - bend.displacement(after_mm, centre_mm)
        return np.asarray(moved - self.before_mm)

    def field(self, values: Float, errors: SharedErrors, more: Float) -> GaugeField:
        """Return the corrected field of the frame for a motion with these values (9,).

        `more`, shape (3, 3): covariance of errors of exx, eyy, exy in addition to those of the correction.
        """
        noise = errors.noise + more
        found = GaugeField(self._displacement, noise, errors.corrected, self._measure, errors.mounting)
        self._fields.write_corrected(found, self.vector(values))
        return found

    def by_values(self, values: Float) -> Float:
        """Return the derivatives (3, 9) of the mean strains exx, eyy, exy by the values (9,) of the motion.

        They are NaN if fewer than three points have a displacement.
        """
        use = self._fields.valid
        if np.count_nonzero(use) < _POINTS_OF_A_PLANE:
            return np.full((3, len(values)), np.nan)
        before_mm, steps = self.before_mm[use], np.diag(_STEPS)
        tried = [values, *(values + step for step in steps)]
        gradients = [slopes_of(before_mm, self.vector(each)[use]) for each in tried]
        by_gradient = strain_by_gradient(gradients[0], self._measure)
        changes = [(each - gradients[0]).ravel() for each in gradients[1:]]
        return np.asarray(by_gradient @ np.column_stack(changes) / _STEPS)
