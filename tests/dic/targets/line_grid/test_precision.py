"""Tests of the accuracy of found intersections, compared with the simulators' camera and grid."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from dic.targets.line_grid.find import find_grid
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid

# Allowed 2-D rms error, px, for each standard deviation of the noise, grey levels.
LIMIT_PX = {1: 0.01, 2: 0.01, 4: 0.018, 6: 0.027}


def _turned(grid: LineGrid, roll_deg: float) -> Surface:
    return Surface(grid, Pose.turned(np.array([0.0, 0.0, 1.0]), roll_deg, np.zeros(3)))


def _grey(light: np.ndarray, blur_px: float, noise: float, seed: int = 5) -> np.ndarray:
    blurred = gaussian_filter(light, blur_px) if blur_px else light
    noisy = 200 * blurred + np.random.default_rng(seed).normal(0, noise, light.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.float32)


def _error_px(image: np.ndarray, camera: PinholeCamera, surface: Surface) -> np.ndarray:
    grid = find_grid(image)
    assert grid.found == 441
    return grid.uv_px - camera.project(surface.world(grid.xy_mm))


def _rms(error_px: np.ndarray) -> float:
    return float(np.sqrt((error_px**2).sum(axis=1).mean()))


@pytest.mark.extended
def test_wide_lines_seen_at_45_degrees_are_not_shifted_by_perspective() -> None:
    """The middle of a 0.15 mm line's image lies 0.006 px from the image of its middle, by differentiation.

    ``u = f x cos θ/(D − x sin θ)``: ``u'' = 2 f sin θ cos θ/D²`` at the middle, and edges at ``± w/2`` put
    the point between them off by ``u'' (w/2)²/2``.
    """
    camera = PinholeCamera(1000, 1000, focal_px=3250.0, pan_deg=45.0)
    surface = _turned(LineGrid(line_width_mm=0.15), 4.0)
    shift_px = 3250.0 / 40.0**2 * 0.075**2 / 2
    error_px = _error_px(_grey(render(camera, surface), 0.7, 0.0), camera, surface)

    assert shift_px > 0.0055
    assert abs(error_px[:, 0].mean()) < shift_px / 5


@pytest.mark.extended
@pytest.mark.parametrize("noise", [2, 6])
def test_fine_lines_hold_to_the_limit_in_a_blurred_noisy_image(noise: int) -> None:
    camera = PinholeCamera(1000, 1000, focal_px=2700.0, pan_deg=30.0)
    surface = _turned(LineGrid(line_width_mm=0.06), 40.0)

    assert _rms(_error_px(_grey(render(camera, surface), 0.8, noise), camera, surface)) < LIMIT_PX[noise]


@pytest.mark.extended
def test_outermost_lines_that_meet_obliquely_are_not_moved_outwards() -> None:
    """The lines meet at 107°. The profiles of an outermost line must not reach the crossing lines."""
    camera = PinholeCamera(1024, 1024, focal_px=2700.0, pan_deg=45.0)
    surface = _turned(LineGrid(line_width_mm=0.15), -30.0)
    error_px = _error_px(_grey(render(camera, surface), 1.0, 0.0), camera, surface)

    assert np.linalg.norm(error_px, axis=1).max() < 0.02


@pytest.mark.long
@pytest.mark.parametrize("line_width_mm", [0.03, 0.08, 0.15])
@pytest.mark.parametrize(("pan_deg", "roll_deg"), [(0, 3), (0, 44), (15, 20), (30, 43), (45, 10), (45, -30)])
def test_every_blur_and_noise_at_any_angle_holds_to_the_limit(
    line_width_mm: float, pan_deg: float, roll_deg: float
) -> None:
    """2048² px, 135 px/mm at the middle: a 10 mm grid that just fits however it is turned."""
    camera = PinholeCamera(2048, 2048, focal_px=5400.0, pan_deg=pan_deg)
    surface = _turned(LineGrid(line_width_mm=line_width_mm), roll_deg)
    light = render(camera, surface)
    rms_px = {
        (blur_px, noise): _rms(_error_px(_grey(light, blur_px, noise), camera, surface))
        for blur_px in (0.5, 1.0, 2.0)
        for noise in LIMIT_PX
    }
    text = ", ".join(f"blur {blur:g} noise {noise}: {rms:.4f}" for (blur, noise), rms in rms_px.items())
    print(f"width {line_width_mm}, pan {pan_deg}°, roll {roll_deg}°: {text}")

    assert all(rms < LIMIT_PX[noise] for (_, noise), rms in rms_px.items()), text
