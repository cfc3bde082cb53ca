"""The live measurement of two cameras: they correct one another's strain for motion out of the plane.

Two cameras see the plane of the surface in each frame, by parallax, from the points of their gauges. A whole
field sees it with less noise, but some time ago. The plane that is used is the mean of both, weighted by
their errors: the noise of the points, and what the age of the field makes uncertain. The curvature of the
surface and the errors of the calibrations, which change slowly, are those of the last field.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.live.camera import LiveCamera, MotionNow
from dic.live.corrected import CorrectedField
from dic.live.fields import LiveFields
from dic.live.image import LiveImage
from dic.live.motion import Bend, FieldMotion
from dic.live.pairing import GaugePairs, PlaneFound
from dic.live.reasons import Reason
from dic.live.setup import LiveSetup, calibrations_of
from dic.out_of_plane.reference_match import match_references
from dic.out_of_plane.reference_surface import ReferenceSurface
from dic.out_of_plane.two_cameras import seen_calibrations


def surface_of(first: LiveSetup, second: LiveSetup) -> ReferenceSurface:
    """Find the plane of the specimen's surface in the reference images of two cameras.

    This takes some seconds, once before the test.

    Raises
    ------
    GaugeError
        If a camera has no calibration with a pinhole model.
    """
    references = np.asarray(first.reference, np.float32), np.asarray(second.reference, np.float32)
    return match_references(references, calibrations_of(first, second))


class LivePair:
    """Measure the gauges of two cameras in each pair of frames.

    Parameters
    ----------
    first, second : LiveCamera
        The more oblique camera comes first.
    surface : ReferenceSurface, optional
        Place of the surface in the reference, from `surface_of`. Default: the grid's plane.

    Raises
    ------
    GaugeError
        If a camera has no calibration with a pinhole model.
    """

    def __init__(
        self, first: LiveCamera, second: LiveCamera, surface: ReferenceSurface | None = None
    ) -> None:
        self.cameras = first, second
        known = calibrations_of(first.setup, second.setup)
        self._mm_per_px = known[0].mm_per_px
        plane = None if surface is None else surface.plane
        centres = (None, None) if surface is None or surface.centres_mm is None else surface.centres_mm
        one, other = (
            CorrectedField(camera.fields, camera.setup.at_rest, calibration, plane, centre_mm)
            for camera, calibration, centre_mm in zip(
                self.cameras, seen_calibrations(known, surface), centres, strict=True
            )
        )
        self._corrected = first.corrected, second.corrected = one, other
        self._pairs = GaugePairs.of(self._fields, self._corrected)

    def __repr__(self) -> str:
        return f"LivePair({self.cameras[0]}, {self.cameras[1]}, {len(self._pairs.chosen)} pairs)"

    def measure(
        self, images: tuple[NDArray[Any], NDArray[Any]], time_s: float
    ) -> tuple[LiveImage, LiveImage]:
        """Return the readings of all gauges in the next frames of both cameras, taken at the same time.

        Raises
        ------
        CorrelationError
            As for `LiveCamera.measure`.
        """
        first, second = self.cameras
        reasons = first.locate(images[0], time_s), second.locate(images[1], time_s)
        return self.read(images, time_s, reasons)

    def read(
        self,
        images: tuple[NDArray[Any], NDArray[Any]],
        time_s: float,
        reasons: tuple[Reason, Reason],
        only: int | None = None,
    ) -> tuple[LiveImage, LiveImage]:
        """Return the readings of the frames that both cameras located last.

        `reasons`: results of `LiveCamera.locate`, which can find the points in one frame before the other one
        has come. `only`: number of the camera whose gauges are read. Default: both.
        """
        first, second = self.cameras
        motions = first.motion_now(time_s), second.motion_now(time_s)
        if not any(reasons):
            motions = self._seen_now(motions)
        one, other = (
            camera.pass_over(image, time_s, reason)
            if only not in (None, k)
            else camera.read(image, time_s, reason, motion)
            for k, (camera, image, reason, motion) in enumerate(
                zip(self.cameras, images, reasons, motions, strict=True)
            )
        )
        return one, other

    def take(self, motions: tuple[FieldMotion, FieldMotion]) -> None:
        """Take the motion out of the plane that the fields of both cameras have shown; see `PairSolver`."""
        for camera, motion in zip(self.cameras, motions, strict=True):
            camera.take(motion)

    def _seen_now(self, expected: tuple[MotionNow, MotionNow]) -> tuple[MotionNow, MotionNow]:
        """Return the motion that the gauges' points and the fields together show."""
        found = self._pairs.plane(
            self._fields, self._corrected, Bend(expected[0].values[3:]), self._mm_per_px
        )
        if found is None:
            return expected
        first, second = (
            self._with_plane(camera, motion, found)
            for camera, motion in zip(self.cameras, expected, strict=True)
        )
        return first, second

    def _with_plane(self, camera: LiveCamera, expected: MotionNow, found: PlaneFound) -> MotionNow:
        if expected.errors is None or camera.track is None:
            return expected
        if not found.agrees:
            return replace(expected, reason=Reason.CAMERAS_DISAGREE)
        values, covariance = expected.values.copy(), expected.covariance.copy()
        of_field = expected.covariance[:3, :3]
        values[:3], covariance[:3, :3] = found.values, found.covariance
        if np.isfinite(of_field).all():
            gain = of_field @ np.linalg.inv(of_field + found.covariance)
            values[:3] = expected.values[:3] + gain @ (found.values - expected.values[:3])
            covariance[:3, :3] = of_field - gain @ of_field
        # The plane was measured now, so only the bend is old.
        covariance[:3, 3:] = covariance[3:, :3] = 0.0
        to_strain = camera.track.by_values
        return replace(
            expected, values=values, covariance=covariance, more=to_strain @ covariance @ to_strain.T
        )

    @property
    def _fields(self) -> tuple[LiveFields, LiveFields]:
        first, second = self.cameras
        return first.fields, second.fields
