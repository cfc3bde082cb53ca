from dataclasses import dataclass

import numpy as np
import pytest

from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid, Speckle

WHITE_GREY = 255 * 10 / 12


@dataclass(frozen=True)
class OneDot:
    """A texture with a single smooth dot with a diameter of 0.16 mm."""

    centre_mm: tuple[float, float]
    quadrature_order: int = 2

    def reflectance(self, points_mm):
        distance2 = np.sum((points_mm - np.array(self.centre_mm)) ** 2, axis=1)
        return np.clip(1 - distance2 / 0.08**2, 0, None) ** 4


def centroid(image):
    y, x = np.indices(image.shape)
    return np.array([np.sum(x * image), np.sum(y * image)]) / image.sum()


def projected_centroid(camera, surface):
    """Return the centroid of the dot's image, from projected points alone, by a change of variables."""
    step_mm = 0.001
    axis = np.arange(-0.08, 0.08 + step_mm / 2, step_mm)
    X, Y = np.meshgrid(axis + surface.texture.centre_mm[0], axis + surface.texture.centre_mm[1])
    material = np.column_stack([X.ravel(), Y.ravel()])
    px = camera.project(surface.world(material)).reshape(*X.shape, 2)
    du, dv = np.gradient(px[..., 0]), np.gradient(px[..., 1])
    weight = surface.texture.reflectance(material).reshape(X.shape) * np.abs(du[1] * dv[0] - du[0] * dv[1])
    return np.einsum("ij,ijk->k", weight, px) / weight.sum()


@pytest.mark.parametrize(
    ("camera", "pose", "gradient"),
    [
        (PinholeCamera(200, 200), Pose(), np.eye(2)),
        (PinholeCamera(200, 200, pan_deg=30), Pose.sloped(1.0, -2.0, 0.1), np.eye(2)),
        (
            PinholeCamera(200, 200, tilt_deg=30, k1_per_px2=1e-7),
            Pose.turned(np.array([0.003, 0, 1]), 157.5, np.zeros(3)),
            np.array([[0.975, 0.01], [0.0, 1.05]]),
        ),
    ],
)
def test_a_dot_appears_where_its_material_point_is_projected(camera, pose, gradient):
    surface = Surface(OneDot((0.613, -0.371)), pose, gradient, np.array([0.02, -0.05]))
    np.testing.assert_allclose(
        centroid(render(camera, surface)), projected_centroid(camera, surface), atol=2e-4
    )


@pytest.mark.parametrize("texture", [Speckle.sprayed(1), LineGrid()])
@pytest.mark.parametrize("pan_deg", [pytest.param(0, marks=pytest.mark.extended), 30])
def test_quadrature_is_finer_than_the_noise_of_one_grey_level(texture, pan_deg):
    camera = PinholeCamera(300, 300, pan_deg=pan_deg)
    surface = Surface(texture, Pose.turned(np.array([0, 0, 1.0]), 10.0, np.zeros(3)))
    error = WHITE_GREY * (render(camera, surface) - render(camera, surface, quadrature_order=8))
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.abs(error).max() < 0.5


def test_a_pixel_shows_the_mean_over_its_area_and_not_its_middle():
    camera = PinholeCamera(60, 60)
    surface = Surface(OneDot((0.0, 0.0)))
    # 70 px/mm: the dot's volume is pi R² / 5 in mm², hence this many px².
    assert render(camera, surface).sum() == pytest.approx(np.pi * 0.08**2 / 5 * 70**2, rel=1e-4)


def test_a_picture_of_any_shape_is_rendered_whole():
    image = render(PinholeCamera(41, 77), Surface(LineGrid()))
    assert image.shape == (77, 41)
    np.testing.assert_allclose(image, image[::-1, ::-1], atol=1e-9)
