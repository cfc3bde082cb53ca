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
from dic.live.setup import LiveSetup, calibrations_of
from dic.live.sought import LostPlaces, Sought
from dic.out_of_plane.correct import correct
from dic.out_of_plane.correction import stated
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.reference_surface import ReferenceSurface
from dic.out_of_plane.two_cameras import solve_with_two_cameras, step_of
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


class PairSolver:
    """Measure whole fields of two cameras, and correct them together.

    Parameters
    ----------
    first, second : LiveSetup
        Those of the cameras' live gauges, in the order of `LivePair`.
    surface : ReferenceSurface, optional
        Place of the surface in the reference, from `surface_of`.
    coarser : int
        As for `FieldSolver`.

    Attributes
    ----------
    solvers : tuple of FieldSolver
        The solvers of the two cameras, for example to seek lost points.
    """

    def __init__(
        self,
        first: LiveSetup,
        second: LiveSetup,
        surface: ReferenceSurface | None = None,
        coarser: int = _STEP,
    ) -> None:
        self.solvers = FieldSolver(first, coarser), FieldSolver(second, coarser)
        self._calibrations, self._surface = calibrations_of(first, second), surface

    def __repr__(self) -> str:
        return f"PairSolver({self.solvers[0]}, {self.solvers[1]})"

    def solve(
        self, images: tuple[NDArray[Any], NDArray[Any]], time_s: float
    ) -> tuple[FieldMotion, FieldMotion]:
        """Return the motion out of the plane that both frames together show, for `LivePair.take`.

        Raises
        ------
        CorrelationError
            If a frame does not show the reference's pattern.
        """
        (first, second), calibrations = self.solvers, self._calibrations
        both = first.measured(images[0]), second.measured(images[1])
        joint = solve_with_two_cameras(both, calibrations, self._surface)
        found = []
        for k, (measured, calibration) in enumerate(zip(both, calibrations, strict=True)):
            if isinstance(joint, str):
                unknown = correct([measured], calibration, Motion()).images[0]
                unknown = replace(unknown, declined=joint)
                found.append(FieldMotion.of(stated(measured, unknown), unknown, calibration, time_s))
                continue
            correction = step_of(both, joint).corrections[k]
            pairs = joint.system.pairs
            seen = (pairs.first, pairs.second)[k], joint.system.centres_mm[k]
            found.append(FieldMotion.of(stated(measured, correction), correction, calibration, time_s, seen))
        return found[0], found[1]
