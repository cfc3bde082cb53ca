"""The plane of a specimen's surface is found from rendered reference images of two cameras."""

import numpy as np
import pytest

from dic.out_of_plane.reference_match import match_references
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import Speckle
from tests.dic.out_of_plane.exact_views import View

CAMERAS = {
    name: PinholeCamera(400, 400, focal_px=1400.0, tilt_deg=tilt_deg)
    for name, tilt_deg in (("aside", 30.0), ("straight", 0.0))
}


def pictured(name, mounted):
    camera = CAMERAS[name]
    picture = render(camera, Surface(Speckle.sprayed(4), mounted)).astype(np.float32)
    noise = np.random.default_rng(len(name)).normal(0.0, 0.004 * np.ptp(picture), picture.shape)
    view = View(camera, grid_noise_px=0.004)
    return picture + noise.astype(np.float32), view.calibration()


def test_the_plate_that_carried_the_grid_is_found():
    surface = match_references(
        *zip(*(pictured(name, Pose.sloped(0.1, 0.0, -1.0)) for name in CAMERAS), strict=True)
    )
    assert surface.problem == ""
    assert surface.plane.shift_mm == pytest.approx(-1.0, abs=0.005)
    assert np.degrees(np.arctan(surface.plane.slope_x)) == pytest.approx(0.1, abs=0.05)
    assert "1.00" in surface.text
    assert "behind the grid's plane" in surface.text


def test_images_of_other_specimens_are_said_not_to_match():
    aside, straight = (pictured(name, Pose()) for name in CAMERAS)
    images = aside[0], np.zeros_like(straight[0])
    surface = match_references(images, (aside[1], straight[1]))
    assert surface.plane is None
    assert "not known" in surface.text


def test_images_of_another_size_are_matched_too():
    aside, straight = (pictured(name, Pose.sloped(0.0, 0.0, -0.5)) for name in CAMERAS)
    larger = np.pad(straight[0], ((0, 20), (0, 10)), mode="edge")
    surface = match_references((aside[0], larger), (aside[1], straight[1]))
    assert surface.plane.shift_mm == pytest.approx(-0.5, abs=0.005)
