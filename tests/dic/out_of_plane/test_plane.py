"""Positions of calibrated points on a sloped surface are compared with the simulators' geometry."""

import numpy as np
import pytest

from dic.out_of_plane.plane import Plane, moved_out_of_plane
from dic.strain.displacement import Displacement, Noise
from simulators.scene.pose import Pose
from simulators.scene.scene import Surface
from tests.dic.out_of_plane.exact_views import Blank

CENTRE = np.array([-9.0, 18.0, 34.0])
POINTS = np.stack(np.meshgrid(np.linspace(-4, 4, 7), np.linspace(-3, 5, 6)), axis=-1).reshape(-1, 2)
SLOPED = [(0.0, 0.0, 0.0), (0.3, -2.0, 0.0), (-1.5, 0.7, 0.4), (0.0, 0.0, -0.2)]


def plane_of(slope_x_deg, slope_y_deg, shift_mm):
    return Plane(np.tan(np.radians(slope_x_deg)), np.tan(np.radians(slope_y_deg)), shift_mm)


@pytest.mark.parametrize("sloped", SLOPED)
def test_points_lie_where_rays_meet_the_material(sloped):
    rays = np.column_stack([POINTS, np.zeros(len(POINTS))]) - CENTRE
    met = Surface(Blank(), Pose.sloped(*sloped)).material(CENTRE, rays)
    np.testing.assert_allclose(plane_of(*sloped).within(POINTS, CENTRE), met, atol=1e-12)


@pytest.mark.parametrize("sloped", SLOPED)
def test_the_jacobian_is_that_of_differences(sloped):
    plane, step = plane_of(*sloped), 1e-5
    differences = [
        (plane.within(POINTS + d, CENTRE) - plane.within(POINTS - d, CENTRE)) / (2 * step)
        for d in step * np.eye(2)
    ]
    np.testing.assert_allclose(plane.jacobian(POINTS, CENTRE), np.stack(differences, -1), atol=1e-9)


@pytest.mark.parametrize("sloped", SLOPED)
def test_the_derivatives_are_those_of_differences(sloped):
    plane, step = plane_of(*sloped), 1e-5
    values = np.array([plane.slope_x, plane.slope_y, plane.shift_mm])
    differences = [
        (Plane(*(values + d)).within(POINTS, CENTRE) - Plane(*(values - d)).within(POINTS, CENTRE))
        / (2 * step)
        for d in step * np.eye(3)
    ]
    np.testing.assert_allclose(plane.derivatives(POINTS, CENTRE), np.stack(differences, -1), atol=1e-8)


def test_a_plane_across_a_direction_contains_its_point():
    plane = Plane.across(np.array([0.1, -0.2, 2.0]), np.array([3.0, 1.0, 0.5]))
    np.testing.assert_allclose(np.cross(plane.normal, [0.1, -0.2, 2.0]), 0, atol=1e-15)
    assert plane.shift_mm + 3.0 * plane.slope_x + 1.0 * plane.slope_y == pytest.approx(0.5)


def test_the_axes_within_a_plane_are_orthonormal_and_in_it():
    plane = plane_of(12.0, -7.0, 0.0)
    np.testing.assert_allclose(plane.axes @ plane.axes.T, np.eye(2), atol=1e-14)
    np.testing.assert_allclose(plane.axes @ plane.normal, 0, atol=1e-14)


def test_a_material_that_only_leaves_the_plane_is_not_strained():
    material = np.stack(np.meshgrid(np.linspace(-3, 3, 8), np.linspace(-3, 3, 8)), axis=-1)
    world = Surface(Blank(), Pose.sloped(0.3, -0.4, 0.05)).world(material.reshape(-1, 2))
    reach = CENTRE[2] / (CENTRE[2] - world[:, 2:])
    seen = (CENTRE[:2] + (world[:, :2] - CENTRE[:2]) * reach).reshape(material.shape)
    calibrated = Displacement(
        material, seen - material, np.ones(material.shape[:2], bool), "mm", np.zeros((8, 8, 2, 2))
    )
    assert np.abs(calibrated.vector).max() > 0.01
    moved = moved_out_of_plane(calibrated, CENTRE, Plane(), plane_of(0.3, -0.4, 0.05))
    np.testing.assert_allclose(moved.vector, 0, atol=1e-13)


def test_errors_are_mapped_to_the_plane_also_without_gradients():
    position = POINTS.reshape(6, 7, 2)
    noise = Noise(
        factors=np.broadcast_to(np.eye(2), (6, 7, 2, 2)),
        overlap=np.ones((1, 1)),
        gradient=np.broadcast_to(np.nan, (6, 7, 4, 4)),
        bias=np.broadcast_to(1e-3 * np.eye(2), (6, 7, 2, 2)),
    )
    calibrated = Displacement(
        position, np.zeros((6, 7, 2)), np.ones((6, 7), bool), "mm", gradient=None, noise=noise
    )
    plane = plane_of(20.0, 0.0, 0.0)
    moved = moved_out_of_plane(calibrated, CENTRE, plane, plane)
    np.testing.assert_allclose(moved.noise.factors, plane.jacobian(position, CENTRE))
    np.testing.assert_allclose(moved.noise.bias, plane.jacobian(position, CENTRE) @ noise.bias)
