"""Measures whole fields beside the live gauges: the motion out of the plane, and points that are lost.

This takes a good part of a second for each frame. So it runs in another process or thread than the live
gauges, on a copy of a frame now and then.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.field import Field
from dic.errors import GaugeError
from dic.live.motion import FieldMotion
from dic.live.setup import LiveSetup
from dic.live.sought import LostPlaces, Sought
from dic.out_of_plane.correct import correct
from dic.out_of_plane.correction import stated
from dic.out_of_plane.motion import Motion
from dic.strain.measurement import Measurement, measure

_STEP = 2
"""The points of the fields are this many times as far apart as those of the gauges."""


class FieldSolver:
    """Measure whole fields of one camera with the code of the offline measurement.

    Parameters
    ----------
    setup : LiveSetup
        That of the camera's live gauges.
    coarser : int
        The points are this many times as far apart as offline, which saves time. The motion out of the plane
        needs few points.
    """

    def __init__(self, setup: LiveSetup, coarser: int = _STEP) -> None:
        step_px = max(1, coarser) * setup.correlation.step_px
        self.setup = setup
        self._coarse = replace(setup, correlation=replace(setup.correlation, step_px=step_px))
        self._previous: Field | None = None

    def __repr__(self) -> str:
        return f"FieldSolver({self._coarse})"

    def measured(self, image: NDArray[Any]) -> Measurement:
        """Return the measurement of a frame, with the errors that the images cause.

        Raises
        ------
        CorrelationError
            If the frame does not show the reference's pattern.
        """
        coarse = self._coarse
        field = coarse.correlator.correlate(np.array(image), previous=self._previous)
        self._previous = field
        return measure(field, coarse.calibration, coarse.strain)

    def solve(self, image: NDArray[Any], time_s: float) -> FieldMotion:
        """Return the motion out of the plane that a frame shows, for `LiveCamera.take`.

        `time_s`: time of the frame, on the clock of the live frames.

        Raises
        ------
        CorrelationError
            If the frame does not show the reference's pattern.
        GaugeError
            If the set-up has no calibration.
        """
        calibration = self.setup.calibration
        if calibration is None:
            remedy = "calibrate the camera with an image of the grid, and give calibration=…"
            raise GaugeError("live gauges", "solve the field", "a calibration", "none", remedy)
        measured = self.measured(image)
        correction = correct([measured], calibration, self.setup.motion or Motion()).images[0]
        return FieldMotion.of(stated(measured, correction), correction, calibration, time_s)

    def seek(self, image: NDArray[Any], lost: LostPlaces) -> Sought:
        """Search lost points in a whole frame, wherever they may be, for `LiveCamera.accept`."""
        found = self.setup.correlator.seek(np.array(image), np.stack(lost, axis=1))
        rows, columns = found.indices.T
        return Sought(rows, columns, found.solution.warps, found.start)
