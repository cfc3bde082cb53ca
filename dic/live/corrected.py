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
from dic.strain.strain import strain_of_gradient
from dic.typing import Float


class CorrectedField:
    """The corrected field of one camera.

    `reference`: the measurement of the reference with itself. `calibration`: calibration of the camera, with a
    pinhole model. `surface`: plane of the surface in the reference; displacements are along this plane.
    `centre_mm`, shape (3,): the camera's centre in the grid's axes, if it is known better than from the
    calibration.
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
        same = calibration.model == best.model
        self._map = None if same else LocalMap(best, fields.before_px)
        field = fields.calibrated.displacement
        position = field.position
        if not same:
            px = np.stack([reference.field.points], axis=0).reshape(-1, 2)
            position = best.map(px).reshape(position.shape)
        if surface is not None:
            position = surface.within(position, self._grid_centre_mm)
        # The errors are those of calibrated displacements, as offline.
        self._displacement = replace(blank(replace(field, noise=None)), position=position, noise=field.noise)
        self.before_mm = position[fields.grid_at]
        self.after_mm = self.before_mm
        self._measure = fields.measure
        self._moves = surface is not None

    @property
    def centre_mm(self) -> Float:
        """The camera's centre in the axes of the surface, shape (3,)."""
        return self._surface.to_axes(self._grid_centre_mm)

    def take(self) -> None:
        """Compute the places of the points of a frame along the surface of the reference."""
        after_mm = self._fields.after_mm
        if self._map is not None:
            after_mm, _ = self._map.at(self._fields.after_px)
        self.after_mm = self._surface.within(after_mm, self._grid_centre_mm) if self._moves else after_mm

    def vector(self, plane: Plane, bend: Bend) -> Float:
        """Return the displacements (n, 2) within the surface if it has moved to a plane and is bent."""
        after_mm, centre_mm = self.after_mm, self.centre_mm
        moved = plane.within(after_mm, centre_mm) - bend.displacement(after_mm, centre_mm)
        return np.asarray(moved - self.before_mm)

    def field(self, plane: Plane, bend: Bend, errors: SharedErrors, more: Float) -> GaugeField:
        """Return the corrected field of the frame.

        `more`, shape (3, 3): covariance of errors of exx, eyy, exy in addition to those of the correction.
        """
        found = GaugeField(
            self._displacement, errors.noise + more, errors.corrected, self._measure, errors.mounting
        )
        self._fields.write_corrected(found, self.vector(plane, bend))
        return found

    def effect(self, values: Float) -> Float:
        """Return the mean strains exx, eyy, exy, shape (3,), for plane and bend with these values (9,)."""
        vector = self.vector(Plane(*values[:3].tolist()), Bend(values[3:]))
        use = self._fields.valid
        if np.count_nonzero(use) < 3:
            return np.full(3, np.nan)
        mean = strain_of_gradient(slopes_of(self.before_mm[use], vector[use]), None, int(use.sum()), self._measure)
        return np.array([mean.exx, mean.eyy, mean.exy])
