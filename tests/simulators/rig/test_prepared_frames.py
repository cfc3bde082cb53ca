"""Frames from prepared pictures: `dic` measures in them what it measures in exact ones, and the truth is exact."""

from itertools import pairwise

import numpy as np
import pytest

from dic import CorrelationSettings, Correlator
from drivers.clock import VirtualClock
from drivers.errors import DeviceFault
from simulators.rig.camera import SimulatedCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.painters import ExactPainter, PreparedPainter
from simulators.rig.surroundings import PreparedSettings, Surroundings
from simulators.scene.pose import Pose
from simulators.scene.scene import Misalignment, Scene, Surface
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.scene.texture import Speckle
from simulators.scene.torn import Torn

SIDE = 320
QUIET = {"bits": 12, "full_well_e": 1e12, "read_noise_e": 0.0, "width_px": SIDE, "height_px": SIDE}
SPECKLE = Speckle.sprayed(1)
CAMERAS = {"straight": {}, "raised": {"tilt_deg": 30.0}, "bulging": {"tilt_deg": 30.0, "k1_per_px2": -4e-8}}
STATES = {
    "sub-pixel shift": Surface(SPECKLE, shift_mm=np.array([0.0123, 0.0071])),
    "elastic": Surface(SPECKLE, Pose.sloped(0.0, -0.1), np.diag([1 - 0.6e-3, 1 + 2e-3])),
    "plastic": Surface(SPECKLE, Pose.sloped(0.2, -0.1, 0.02), np.diag([0.975, 1.05])),
    "turned": Surface(SPECKLE, Pose.turned(np.array([0.01, 0.0, 1.0]), 4.0, np.array([0.1, 0.0, 0.0]))),
}


def pictures(camera, surface, seed=1):
    settings = CameraSettings(**QUIET | CAMERAS[camera])
    exact = ExactPainter(settings, seed, camera)
    fast = PreparedPainter(settings, seed, camera, 120, None, lambda line: None)
    fast.prepare(Surface(SPECKLE))
    light = Surroundings.of(VirtualClock()).pictures.light
    del light
    return exact, fast


@pytest.mark.parametrize("camera", CAMERAS)
def test_dic_measures_the_same_displacement_as_in_exact_frames(camera):
    settings = CameraSettings(**QUIET | CAMERAS[camera])
    exact, fast = pictures(camera, None)
    from simulators.rig.light import Light

    correlator = Correlator(exact.paint([(1.0, Surface(SPECKLE))], Light(), 0), settings=CorrelationSettings())
    for name, surface in STATES.items():
        images = [painter.paint([(1.0, surface)], Light(), 1) for painter in (exact, fast)]
        a, b = (correlator.correlate(image) for image in images)
        good = a.converged & b.converged
        d = np.stack([(b.u_px - a.u_px)[good], (b.v_px - a.v_px)[good]])
        print(camera, name, good.sum(), 'std', d.std(axis=1), 'mean', d.mean(axis=1), 'max', abs(d).max())
