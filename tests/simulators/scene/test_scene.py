import numpy as np
import pytest

from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Misalignment, Scene, Surface
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.scene.texture import LineGrid, Speckle

POINTS_MM = np.stack(np.meshgrid(*[np.linspace(-3, 3, 13)] * 2), axis=-1).reshape(-1, 2)
MICROSTRAIN = 1e6
TAN_30 = np.tan(np.radians(30))


def scene_with(angle_deg=0.0, displacement_mm=0.0, specimen=None, **misalignment):
    bone = SimulatedSpecimen(specimen or SpecimenSettings())
    return Scene(
        seed=1,
        misalignment=Misalignment(**misalignment),
        specimen=bone,
        angle_deg=lambda: angle_deg,
        load_n=lambda: bone.stretch_to(displacement_mm),
    )


def seen_in_the_grid_plane(camera, surface):
    """Return the positions (n, 2), mm, that an exact calibration on z = 0 gives for the specimen's points."""
    return Surface(LineGrid()).material(*camera.ray(camera.project(surface.world(POINTS_MM))))


def green_lagrange(reference_mm, deformed_mm):
    design = np.column_stack([reference_mm, np.ones(len(reference_mm))])
    F = np.linalg.lstsq(design, deformed_mm, rcond=None)[0][:2].T
    return 0.5 * (F.T @ F - np.eye(2)) * MICROSTRAIN


def rotation_error(camera, angle_deg, **misalignment):
    rest, turned = (
        seen_in_the_grid_plane(camera, scene_with(angle, **misalignment).surface())
        for angle in (0.0, angle_deg)
    )
    return green_lagrange(rest, turned)


def test_a_slope_is_the_slope_of_the_plane():
    pose = Pose.sloped(2.0, -3.0, 0.4)
    x, y, z = pose.apply(np.column_stack([POINTS_MM, np.zeros(len(POINTS_MM))])).T
    np.testing.assert_allclose(z, np.tan(np.radians(2)) * x - np.tan(np.radians(3)) * y + 0.4, atol=1e-12)


def test_motions_chain_and_go_back():
    first, then = Pose.sloped(3, 1, 0.2), Pose.turned(np.array([0.1, 0, 1]), 40, np.array([1.0, 2, 0]))
    points = np.random.default_rng(1).normal(size=(20, 3))
    there = then.after(first).apply(points)
    np.testing.assert_allclose(there, then.apply(first.apply(points)), atol=1e-12)
    np.testing.assert_allclose(then.after(first).inverse().apply(there), points, atol=1e-12)


def test_the_stage_turns_x_towards_y_about_its_own_axis():
    world = scene_with(90.0, axis_x_mm=1.0, axis_y_mm=0.5).surface().world(np.array([[1.0, 0.5], [2.0, 0.5]]))
    np.testing.assert_allclose(world, [[1, 0.5, 0], [1, 1.5, 0]], atol=1e-12)


def test_a_ray_meets_the_material_point_that_was_projected():
    surface = Surface(
        LineGrid(),
        Pose.turned(np.array([0.02, -0.01, 1]), 130, np.array([0.3, 0, 0.1])),
        np.array([[0.97, 0.02], [-0.01, 1.05]]),
        np.array([0.1, -0.2]),
    )
    camera = PinholeCamera(900, 900, pan_deg=20, tilt_deg=20, k1_per_px2=1e-8)
    px = camera.project(surface.world(POINTS_MM))
    np.testing.assert_allclose(surface.material(*camera.ray(px)), POINTS_MM, atol=1e-11)


def test_a_point_off_the_grid_plane_is_seen_where_geometry_says():
    camera = PinholeCamera(900, 900, pan_deg=25, tilt_deg=10)
    surface = scene_with(60.0, axis_slope_x_deg=0.7, grid_slope_y_deg=-0.4, grid_gap_mm=0.2).surface()
    x, y, z = surface.world(POINTS_MM).T
    Cx, Cy, Cz = camera.centre_mm
    expected = np.column_stack([Cx + (x - Cx) * Cz / (Cz - z), Cy + (y - Cy) * Cz / (Cz - z)])
    np.testing.assert_allclose(seen_in_the_grid_plane(camera, surface), expected, atol=1e-10)


@pytest.mark.parametrize(("pan_deg", "theory"), [(30, 4047), (20, 2548), (10, 1232)])
def test_a_specimen_tilted_on_a_true_axis_shows_the_paper_s_false_strain(pan_deg, theory):
    # The axis is the grid's normal; the specimen on it goes from a slope of +0.2° to one of -0.2°.
    error = rotation_error(
        PinholeCamera(900, 900, pan_deg=pan_deg), 180.0, grid_slope_x_deg=0.2, axis_slope_x_deg=0.2
    )
    assert error[0, 0] == pytest.approx(theory, abs=2)
    assert abs(error[1, 1]) < 20


@pytest.mark.parametrize(("pan_deg", "theory"), [(30, 4047), (20, 2548), (10, 1232)])
def test_a_tilted_axis_shows_the_paper_s_false_strain(pan_deg, theory):
    error = rotation_error(PinholeCamera(900, 900, pan_deg=pan_deg), 180.0, axis_slope_x_deg=0.2)[0, 0]
    tilt = np.radians(0.4)
    stretch = np.cos(tilt) + np.sin(tilt) * np.tan(np.radians(pan_deg))
    assert error == pytest.approx((stretch**2 - 1) / 2 * MICROSTRAIN, abs=1)
    assert error == pytest.approx(theory, rel=0.02)


def test_a_tilted_grid_shows_at_quarter_turns_only():
    camera = PinholeCamera(900, 900, pan_deg=30)
    assert rotation_error(camera, 90.0, grid_slope_x_deg=0.2)[0, 0] == pytest.approx(2034, abs=10)
    assert rotation_error(camera, 180.0, grid_slope_x_deg=0.2)[0, 0] == pytest.approx(0, abs=1)


def test_a_gap_between_parallel_planes_shows_no_strain():
    error = rotation_error(PinholeCamera(900, 900, pan_deg=30), 90.0, grid_gap_mm=0.2)
    np.testing.assert_allclose(error, 0, atol=1e-3)


def test_a_gap_lays_the_specimen_behind_the_grid():
    camera = PinholeCamera(64, 64, distance_mm=40.0)
    surface = scene_with(grid_gap_mm=0.4).surface()
    np.testing.assert_allclose(surface.world(POINTS_MM)[:, 2], -0.4)
    # 1 % farther from the pinhole, so 1 % smaller
    np.testing.assert_allclose(seen_in_the_grid_plane(camera, surface), POINTS_MM / 1.01)


def test_loading_tips_the_specimen_as_the_load_grows():
    rigid = SpecimenSettings(youngs_modulus_mpa=1e12, yield_stress_mpa=1e6, ultimate_stress_mpa=2e6)
    camera = PinholeCamera(900, 900, tilt_deg=30)
    rest = scene_with(specimen=rigid, loading_slope_y_deg=0.1)
    loaded = scene_with(displacement_mm=1.5, specimen=rigid, loading_slope_y_deg=0.1)
    error = green_lagrange(*(seen_in_the_grid_plane(camera, scene.surface()) for scene in (rest, loaded)))
    part = 1 - np.exp(-loaded.specimen.state.load_n / 2000)
    assert part > 0.9
    assert error[1, 1] == pytest.approx(-part * np.tan(np.radians(0.1)) * TAN_30 * MICROSTRAIN, abs=5)
    assert abs(error[0, 0]) < 1


def test_a_load_shifts_the_specimen_towards_the_camera():
    scene = scene_with(displacement_mm=5.0, loading_shift_mm=0.05)
    height_mm = scene.surface().world(POINTS_MM)[:, 2]
    part = 1 - np.exp(-scene.specimen.state.load_n / 2000)
    np.testing.assert_allclose(height_mm, 0.05 * part, atol=1e-9)


def test_the_gauge_section_stretches_as_the_specimen_says():
    surface = scene_with(displacement_mm=5.0).surface()
    x, y, _ = surface.world(np.array([[1.0, 1.0]]))[0]
    specimen = SimulatedSpecimen(SpecimenSettings())
    specimen.stretch_to(5.0)
    assert x == pytest.approx(1 + specimen.state.transverse_strain)
    assert y == pytest.approx(1 + specimen.state.axial_strain)


def test_the_middle_travels_with_the_moving_grip_when_told_so():
    settings = SpecimenSettings(centre_travel=0.5)
    world = scene_with(displacement_mm=2.0, specimen=settings).surface().world(np.zeros((1, 2)))
    np.testing.assert_allclose(world, [[0, 1, 0]], atol=1e-12)


def test_the_grid_lies_in_its_own_plane_at_rest_and_rides_on_the_specimen():
    tilted = {"grid_slope_x_deg": 1.0, "grid_gap_mm": 0.3, "axis_slope_y_deg": 0.5}
    scene, turned = scene_with(**tilted), scene_with(90.0, **tilted)
    assert isinstance(scene.surface().texture, Speckle)
    gap = scene.surface().world(POINTS_MM)
    scene.grid_attached = turned.grid_attached = True
    grid = scene.surface()
    assert isinstance(grid.texture, LineGrid)
    np.testing.assert_allclose(grid.world(POINTS_MM)[:, 2], 0, atol=1e-12)
    distance = np.linalg.norm(grid.world(POINTS_MM) - gap, axis=1)
    ridden = turned.surface().world(POINTS_MM)
    turned.grid_attached = False
    np.testing.assert_allclose(np.linalg.norm(ridden - turned.surface().world(POINTS_MM), axis=1), distance)
