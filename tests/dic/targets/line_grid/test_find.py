from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from dic.errors import CalibrationError
from dic.targets.line_grid.find import find_grid
from tests.dic.targets.drawings import View, dots

Draw = Callable[..., Any]
PAPER: dict[str, Any] = {"size_px": (900, 900), "focal_px": 2800.0}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    ("view", "limit_px"),
    [
        pytest.param({"noise": 2}, 0.01, marks=pytest.mark.extended),
        pytest.param({"noise": 6}, 0.025, marks=pytest.mark.extended),
        ({"noise": 2, "pan_deg": 30}, 0.01),
        pytest.param(
            {"noise": 6, "pan_deg": 25, "tilt_deg": 20, "blur_px": 1.0, "line_mm": 0.11},
            0.025,
            marks=pytest.mark.extended,
        ),
    ],
)
def test_all_intersections_are_found_to_a_hundredth_pixel(
    draw_grid: Draw, view: dict[str, Any], limit_px: float
) -> None:
    picture = draw_grid(**PAPER | {"focal_px": 2600.0} | view)
    grid = find_grid(picture.image)

    assert grid.found == grid.expected == 441
    assert _rms(picture.errors_px(grid)) < limit_px


def test_without_noise_the_bias_is_thousandths_of_a_pixel(draw_grid: Draw) -> None:
    picture = draw_grid(noise=0, pan_deg=20, roll_deg=7)

    assert _rms(picture.errors_px(find_grid(picture.image))) < 0.004


@pytest.mark.parametrize(
    "view",
    [
        pytest.param({"pan_deg": 45, "roll_deg": 10}, marks=pytest.mark.extended),
        {"pan_deg": -30, "tilt_deg": 30, "roll_deg": -25, "focal_px": 1150},
        pytest.param({"roll_deg": 37, "focal_px": 1150}, marks=pytest.mark.extended),
        pytest.param({"dark_lines": False, "pan_deg": 20}, marks=pytest.mark.extended),
        pytest.param({"gradient": 1.0, "roll_deg": 5}, marks=pytest.mark.extended),
        pytest.param({"k1_per_px2": 4e-7, "pan_deg": 15}, marks=pytest.mark.extended),
        pytest.param({"k1_per_px2": -4e-7, "tilt_deg": -15}, marks=pytest.mark.extended),
        pytest.param({"blur_px": 1.8}, marks=pytest.mark.extended),
        pytest.param({"line_mm": 0.035}, marks=pytest.mark.extended),
        pytest.param({"line_mm": 0.2}, marks=pytest.mark.extended),
        pytest.param({"focal_px": 960, "line_mm": 0.08}, marks=pytest.mark.extended),
        pytest.param({"overhang_mm": 0.2, "pan_deg": 20}, marks=pytest.mark.extended),
        {"dark": 110, "bright": 140},
        pytest.param(
            {"outside": "speckle", "pan_deg": 25, "roll_deg": 12, "focal_px": 1150},
            marks=pytest.mark.extended,
        ),
        {"outside": "speckle", "tilt_deg": 30, "overhang_mm": 0.1, "focal_px": 1150, "dark_lines": False},
    ],
    ids=lambda view: ",".join(f"{name}={value}" for name, value in view.items()),
)
def test_the_grid_is_found_from_anywhere_in_any_light(draw_grid: Draw, view: dict[str, Any]) -> None:
    picture = draw_grid(seed=11, **view)
    grid = find_grid(picture.image)

    assert grid.found == 441
    assert _rms(picture.errors_px(grid)) < 0.04


def test_x_points_right_and_y_up_with_the_origin_at_the_centre(draw_grid: Draw) -> None:
    grid = find_grid(draw_grid(roll_deg=20).image)
    at = {tuple(index): uv for index, uv in zip(grid.index, grid.uv_px, strict=True)}

    assert at[20, 10][0] > at[0, 10][0]
    assert at[10, 20][1] < at[10, 0][1]
    assert grid.xy_mm[(grid.index == [10, 10]).all(axis=1)].tolist() == [[0, 0]]
    assert grid.xy_mm.min() == -5
    assert grid.xy_mm.max() == 5


@pytest.mark.parametrize(
    ("roll_deg", "turned_deg"),
    [(100, 10), (170, -10), *(pytest.param(deg, 10, marks=pytest.mark.extended) for deg in (-80, 190))],
)
def test_a_grid_that_is_turned_further_is_named_by_the_image_s_directions(
    draw_grid: Draw, roll_deg: float, turned_deg: float
) -> None:
    grid = find_grid(draw_grid(roll_deg=roll_deg).image)
    at = {tuple(index): uv for index, uv in zip(grid.index, grid.uv_px, strict=True)}
    right, up = at[20, 10] - at[0, 10], at[10, 20] - at[10, 0]

    assert np.degrees(np.arctan2(-right[1], right[0])) == pytest.approx(turned_deg, abs=0.1)
    assert np.degrees(np.arctan2(-up[1], up[0])) == pytest.approx(90 + turned_deg, abs=0.1)


@pytest.mark.extended
def test_a_grid_turned_by_half_a_right_angle_comes_with_a_warning(draw_grid: Draw) -> None:
    view = {"roll_deg": 44, "focal_px": 1000}

    assert "the other way round" in find_grid(draw_grid(**view).image).warnings[0]
    assert find_grid(draw_grid(roll_deg=30).image).warnings == ()


def test_unequal_numbers_of_lines_are_told_apart(draw_grid: Draw) -> None:
    picture = draw_grid(lines=(21, 15), roll_deg=4)
    grid = find_grid(picture.image, (21, 15))

    assert grid.found == 315
    assert _rms(picture.errors_px(grid)) < 0.02
    with pytest.raises(CalibrationError, match=r"expected a grid of 15 × 21 lines.*got 21 × 15 lines"):
        find_grid(picture.image, (15, 21))


def test_small_grids_of_few_lines_are_found(draw_grid: Draw) -> None:
    picture = draw_grid(lines=(5, 4), pitch_mm=2.0, line_mm=0.1, pan_deg=15)
    grid = find_grid(picture.image, (5, 4), 2.0)

    assert grid.found == 20
    assert _rms(picture.errors_px(grid)) < 0.02


def test_dirt_costs_points_but_not_accuracy(draw_grid: Draw) -> None:
    picture = draw_grid(pan_deg=20)
    dirty, rng = picture.image.copy(), np.random.default_rng(2)
    for _ in range(40):
        place = tuple(int(value) for value in rng.integers(40, 410, 2))
        cv2.circle(dirty, place, 4, float(rng.integers(0, 255)), -1)
    grid = find_grid(dirty)

    assert grid.found >= 0.95 * 441
    assert picture.errors_px(grid).max() < 0.15


def test_a_covered_part_is_left_out(draw_grid: Draw) -> None:
    picture = draw_grid(pan_deg=20)
    covered = picture.image.copy()
    covered[150:200, 200:260] = 128
    grid = find_grid(covered)
    u, v = grid.uv_px.T

    assert 0.9 * 441 <= grid.found < 441
    assert not ((u > 200) & (u < 260) & (v > 150) & (v < 200)).any()


def test_fewer_than_nine_tenths_of_the_points_are_refused(draw_grid: Draw) -> None:
    covered = draw_grid(pan_deg=20).image
    covered[100:300, 150:300] = 128

    with pytest.raises(CalibrationError, match=r"only 3\d\d of 441 intersections"):
        find_grid(covered)


@pytest.mark.parametrize(
    ("view", "got"),
    [
        ({"lines": (20, 21)}, "20 × 21 lines"),
        ({"lines": (22, 23)}, "22 × 23"),
        ({"focal_px": 2000.0}, "lines"),
    ],
)
def test_another_number_of_lines_is_refused(draw_grid: Draw, view: dict[str, Any], got: str) -> None:
    with pytest.raises(CalibrationError, match=f"expected a grid of 21 × 21 lines.*got .*{got}"):
        find_grid(draw_grid(**view).image)


def _checkerboard(angle_deg: float, square_px: float) -> np.ndarray:
    rows, columns = np.mgrid[:500, :500] - 250.0
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    u, v = columns * c + rows * s, rows * c - columns * s
    squares = (np.floor(u / square_px) + np.floor(v / square_px)) % 2
    board = np.where((abs(u) < 10 * square_px) & (abs(v) < 10 * square_px), squares, 1.0)
    return gaussian_filter(60 + 140 * board, 0.7)


def _speckle() -> np.ndarray:
    noise = gaussian_filter(np.random.default_rng(1).normal(size=(500, 500)), 3)
    return 128 + 50 * noise / noise.std()


@pytest.mark.parametrize(
    "picture",
    [
        np.full((400, 400), 128.0),
        np.random.default_rng(0).normal(128, 30, (400, 400)),
        _speckle(),
        _checkerboard(0, 20),
        _checkerboard(30, 22),
        60 + 140.0 * (np.mgrid[:400, :400][0] % 20 > 3),
    ],
    ids=["empty", "noise", "speckle", "checkerboard", "turned checkerboard", "stripes"],
)
@pytest.mark.parametrize("lines", [(21, 21), (12, 11)])
def test_what_is_no_line_grid_is_refused(picture: np.ndarray, lines: tuple[int, int]) -> None:
    with pytest.raises(CalibrationError, match=r"no line grid|cells without lines"):
        find_grid(picture.astype(np.float32), lines)


@pytest.mark.parametrize(
    ("radius_mm", "px_per_mm", "blur_px", "view"),
    [
        pytest.param(0.1, 39.0, 0.8, {}, marks=pytest.mark.extended),
        pytest.param(0.2, 39.0, 0.8, {"roll_deg": 8.0}, marks=pytest.mark.extended),
        (0.3, 39.0, 2.0, {"pan_deg": 40.0, "roll_deg": 20.0}),
        pytest.param(0.38, 39.0, 0.8, {"pan_deg": 15.0}, marks=pytest.mark.extended),
        (0.2, 14.0, 1.0, {"pan_deg": 30.0}),
        pytest.param(0.2, 12.5, 1.5, {"roll_deg": 8.0}, marks=pytest.mark.extended),
    ],
    ids=str,
)
def test_dots_are_not_taken_for_the_cells_between_lines(
    radius_mm: float, px_per_mm: float, blur_px: float, view: dict[str, Any]
) -> None:
    side = round(14.5 * px_per_mm)
    seen = View.of(dots((13, 12), 0.8, radius_mm), size_px=(side, side), focal_px=40 * px_per_mm, **view)
    image = seen.image(blur_px=blur_px)

    # The background between 13 × 12 dots looks like 12 × 11 lines.
    for lines in ((12, 11), (13, 12), (14, 13)):
        with pytest.raises(CalibrationError, match=r"got (round areas|cells) without lines"):
            find_grid(image, lines, 0.8)


@pytest.mark.long
def test_dots_and_cells_are_told_apart_from_any_side(draw_grid: Draw) -> None:
    """0 to 45° off-axis, blur up to half of a dot's radius, noise up to 6: dots of 3 to 26 px, any lines."""
    rng = np.random.default_rng(7)
    for number in range(60):
        view = {"pan_deg": rng.uniform(-45, 45), "roll_deg": rng.uniform(-45, 45)}
        px_per_mm, radius_mm = rng.uniform(14, 40), rng.uniform(0.12, 0.32)
        side = round(14.5 * px_per_mm)
        seen = View.of(dots((13, 12), 0.8, radius_mm), size_px=(side, side), focal_px=40 * px_per_mm, **view)
        blur_px = min(rng.uniform(0.5, 1.6), 0.5 * radius_mm * px_per_mm)
        with pytest.raises(CalibrationError, match=r"got (round areas|cells) without lines|got no line grid"):
            find_grid(seen.image(6.0, blur_px, number), (12, 11), 0.8)
        grid = draw_grid(
            number,
            **view,
            line_mm=rng.uniform(0.03, 0.2),
            blur_px=rng.uniform(0.5, 1.6),
            noise=float(rng.choice([2, 6])),
            focal_px=rng.uniform(950, 1150),
            dark_lines=bool(number % 2),
        )
        assert find_grid(grid.image).found >= 400, (number, view)


@pytest.mark.parametrize(("lines", "pitch_mm"), [((3, 21), 0.5), ((21, 21), 0.0), ((21, 21), float("nan"))])
def test_an_impossible_grid_is_refused_before_looking(lines: tuple[int, int], pitch_mm: float) -> None:
    with pytest.raises(CalibrationError, match=r"such as --lines 21x21 and --pitch-mm 0\.5"):
        find_grid(np.zeros((100, 100), np.float32), lines, pitch_mm)
