"""Measure and correct rendered images: the grid is found, and the speckle images are correlated.

The images have 800 × 800 px, 70 px/mm and one grey level of noise. The settings are the defaults. The
principal point is random, with the distribution that a calibration expects.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.prior import KnownCamera
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.strain.measurement import measure
from dic.targets.line_grid.find import find_grid
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import LineGrid, Speckle
from tests.dic.out_of_plane.exact_views import OffCentre

SENSOR = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)


@dataclass(frozen=True)
class Moved:
    """A plane surface whose material moves within the plane by any given law.

    The function `back` returns the material points (n, 2) that are at given places of the surface, mm.
    """

    texture: object
    pose: Pose
    back: object

    def material(self, origin_mm, directions):
        places = Surface(self.texture, self.pose).material(origin_mm, directions)
        return self.back(places)


class RenderedView:
    """One camera that is calibrated from its image of the grid, and looks at a specimen with speckles.

    Parameters
    ----------
    seed : int
        Seed of pattern and noise.
    camera : int
        Number of the camera; each camera has different noise.
    reference : Pose
        Pose of the specimen in its reference image.
    principal_known : bool
        True if the calibration gets the true principal point as a known value.
    """

    def __init__(self, seed, *, pan_deg=0.0, tilt_deg=0.0, camera=0, reference=None, principal_known=False):
        self._rng = np.random.default_rng([seed, camera])
        # As uncertain as the calibration takes it for: 1 % of the width.
        optics = PinholeCamera(800, 800, pan_deg=pan_deg, tilt_deg=tilt_deg)
        self.optics = OffCentre(optics, self._rng.normal(0.0, 8.0, 2))
        self.speckle = Speckle.sprayed(seed)
        grid = find_grid(self._picture(Surface(LineGrid())))
        known = KnownCamera(principal_px=self.optics.principal_point_px) if principal_known else None
        self.calibration = Calibration.fit(grid, (800, 800), known=known)
        self.settings = CorrelationSettings()
        y, x = np.mgrid[:800, :800]
        region = self.calibration.inside(np.column_stack([x.ravel(), y.ravel()]).astype(float))
        picture = self._picture(Surface(self.speckle, reference or Pose()))
        self._correlator = Correlator(picture, region.reshape(800, 800), self.settings, clip=False)

    def measurement(self, pose, F=None, *, back=None, turn_deg=None):
        """Render an image of the specimen and measure it; the correlation gets a known rotation as hint."""
        if back is None:
            surface = Surface(self.speckle, pose, np.eye(2) if F is None else F)
        else:
            surface = Moved(self.speckle, pose, back)
        hint = None if turn_deg is None else self._homography(turn_deg)
        field = self._correlator.correlate(self._picture(surface), hint=hint)
        return measure(field, self.calibration)

    def _picture(self, surface):
        light = render(self.optics, surface)
        return SENSOR.expose(light, 10_000.0, 1.0, self._rng).astype(np.float32)

    def _homography(self, turn_deg):
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        to_grid = cv2.findHomography(self.calibration.grid.uv_px, self.calibration.grid.xy_mm)[0]
        turned = np.linalg.inv(to_grid) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ to_grid
        return turned / turned[2, 2]
