"""Tests of the direction of X and of the origin: from a mark, an option, or the image's directions."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.targets.line_grid.find import GridPoints, find_grid
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid

Draw = Callable[..., Any]


def _view(
    roll_deg: float, pan_deg: float = 0.0, lines: int = 21, marked: bool = True
) -> tuple[np.ndarray, PinholeCamera, Surface]:
    camera = PinholeCamera(560, 560, focal_px=1450.0, pan_deg=pan_deg)
    turned = Pose.turned(np.array([0.0, 0.0, 1.0]), roll_deg, np.zeros(3))
    surface = Surface(LineGrid(lines=lines, marked=marked, line_width_mm=0.07), turned)
    noise = np.random.default_rng(3).normal(0, 2, (560, 560))
    return np.rint(200 * render(camera, surface) + noise).astype(np.float32), camera, surface


def _errors_px(grid: GridPoints, camera: PinholeCamera, surface: Surface) -> np.ndarray:
    return np.linalg.norm(grid.uv_px - camera.project(surface.world(grid.xy_mm)), axis=1)


@pytest.mark.parametrize(
    "roll_deg", [44, 271, *(pytest.param(deg, marks=pytest.mark.extended) for deg in (0, 137))]
)
def test_a_mark_names_the_axes_however_the_grid_is_turned(roll_deg: float) -> None:
    image, camera, surface = _view(roll_deg, pan_deg=20)
    grid = find_grid(image)

    assert grid.found == 441
    assert grid.orientation == "mark"
    assert grid.warnings == ()
    assert _errors_px(grid, camera, surface).max() < 0.2


@pytest.mark.parametrize("roll_deg", [95, 185])
def test_a_mark_names_the_origin_of_even_numbers_of_lines(roll_deg: float) -> None:
    image, camera, surface = _view(roll_deg, lines=20)
    grid = find_grid(image, (20, 20))

    assert grid.orientation == "mark"
    assert _errors_px(grid, camera, surface).max() < 0.2


@pytest.mark.parametrize("side", [0, 3])
def test_a_mark_tells_which_outer_line_is_hidden(side: int) -> None:
    image, camera, surface = _view(100, pan_deg=15)
    strip = np.array([[4.8, -6], [6, -6], [6, 6], [4.8, 6]]) @ np.linalg.matrix_power([[0, -1], [1, 0]], side)
    cv2.fillPoly(image, [camera.project(surface.world(strip)).astype(np.int32)], 120.0)
    grid = find_grid(image)

    assert grid.found == 420
    assert _errors_px(grid, camera, surface).max() < 0.2


@pytest.mark.extended
def test_an_origin_tells_which_outer_line_is_hidden(draw_grid: Draw) -> None:
    picture = draw_grid(roll_deg=4)
    image = picture.image.copy()
    image[:, :58] = 120
    middle = picture.uv_px[(picture.xy_mm == 0).all(axis=1)][0]
    grid = find_grid(image, origin_px=(middle[0] + 4, middle[1] - 3))

    assert 397 <= grid.found <= 420
    assert np.allclose(grid.uv_px[(grid.xy_mm == 0).all(axis=1)], middle, atol=0.05)
    with pytest.raises(CalibrationError, match="got no intersection near"):
        find_grid(image, origin_px=(middle[0] + 9, middle[1] + 9))
    with pytest.raises(CalibrationError, match="got lines beyond a grid of 21 × 21"):
        find_grid(image, origin_px=(middle[0] - 40, middle[1]))


@pytest.mark.parametrize(
    "x_axis",
    [
        *("up", "left", -46.0),
        *(pytest.param(axis, marks=pytest.mark.extended) for axis in ("right", "down", 44.0, 134.0)),
    ],
)
def test_an_option_names_the_axes(draw_grid: Draw, x_axis: str | float) -> None:
    roll_deg = 44.0 if isinstance(x_axis, float) else 12.0
    grid = find_grid(draw_grid(roll_deg=roll_deg, focal_px=1150.0).image, x_axis=x_axis)
    at = {tuple(index): uv for index, uv in zip(grid.index, grid.uv_px, strict=True)}
    right, up = at[20, 10] - at[0, 10], at[10, 20] - at[10, 0]
    expected_deg = (
        x_axis
        if isinstance(x_axis, float)
        else roll_deg + {"right": 0, "up": 90, "left": 180, "down": 270}[x_axis]
    )

    assert grid.orientation == "option"
    assert grid.warnings == ()
    assert np.exp(1j * np.radians(expected_deg)) == pytest.approx(
        complex(right[0], -right[1]) / np.hypot(*right), abs=0.01
    )
    assert right[0] * up[1] - right[1] * up[0] < 0


def test_a_name_that_fits_two_directions_is_refused_with_the_angle_to_give(draw_grid: Draw) -> None:
    with pytest.raises(
        CalibrationError, match=r"44° from one and 46° from another; give the angle.*as --x-axis 44"
    ):
        find_grid(draw_grid(roll_deg=44, focal_px=1000).image, x_axis="right")


@pytest.mark.parametrize("x_axis", ["north", float("nan")])
def test_what_is_no_direction_is_refused(draw_grid: Draw, x_axis: str | float) -> None:
    with pytest.raises(CalibrationError, match="give --x-axis right"):
        find_grid(draw_grid().image, x_axis=x_axis)


def test_an_option_that_contradicts_the_mark_is_refused() -> None:
    image, _, _ = _view(10)

    assert find_grid(image, x_axis="right").orientation == "mark"
    with pytest.raises(CalibrationError, match="a mark with X in another direction than --x-axis up"):
        find_grid(image, x_axis="up")


def test_three_dots_of_dirt_elsewhere_are_no_mark(draw_grid: Draw) -> None:
    picture = draw_grid(focal_px=1400.0)
    dirty = picture.image.copy()
    for xy_mm in ((1.25, 1.25), (1.75, 1.25), (1.25, 1.75)):
        place = picture.uv_px[np.argmin(np.linalg.norm(picture.xy_mm - np.array(xy_mm) + 0.25, axis=1))]
        cv2.circle(dirty, tuple(np.rint(place + np.array([8.7, -8.7])).astype(int).tolist()), 3, 50.0, -1)
    grid = find_grid(dirty)

    assert grid.orientation == "assumed"
    assert grid.found == 441
