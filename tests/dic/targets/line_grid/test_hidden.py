"""The intersections of partly hidden grids in uneven light never get a wrong index."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.targets.line_grid.find import find_grid

Draw = Callable[..., Any]
# position of the outermost lines of a grid of 21 lines with a pitch of 0.5 mm
END_MM = 5.0


def _placed(picture: Any, xy_mm: list[tuple[float, float]]) -> np.ndarray:
    """Return the image positions of grid positions, by a homography from the picture's true intersections."""
    homography, _ = cv2.findHomography(picture.xy_mm, picture.uv_px)
    return cv2.perspectiveTransform(np.array(xy_mm, float)[:, None], homography)[:, 0]


def _covered(picture: Any, corners_mm: list[tuple[float, float]], grey: float = 120.0) -> np.ndarray:
    image = picture.image.copy()
    cv2.fillPoly(image, [np.rint(_placed(picture, corners_mm)).astype(np.int32)], grey)
    return image


def _rectangle(left: float, bottom: float, right: float, top: float) -> list[tuple[float, float]]:
    return [(left, bottom), (right, bottom), (right, top), (left, top)]


HIDDEN = {
    "inside": (_rectangle(-0.2, 0.3, 2.7, 3.2), 36),
    "a corner": ([(6, 6), (6, 2), (2, 6)], 10),
    "six by six at a corner": (_rectangle(2.3, 2.3, 6, 6), 36),
    "half of an outer line": (_rectangle(4.8, -6, 6, 0.2), 11),
    "70 % of two outer lines": (_rectangle(-6, -6, 1.8, -4.3), 28),
    "a finger": ([(6, 1), (1.5, 0.9), (1.2, 0.5), (1.5, 0.1), (6, -0.3)], 18),
}


@pytest.mark.parametrize(
    "view", [pytest.param({"roll_deg": 3}, marks=pytest.mark.long), {"pan_deg": 30, "roll_deg": 25}], ids=str
)
@pytest.mark.parametrize(
    "what",
    [
        pytest.param(what, marks=pytest.mark.extended if number % 2 else ())
        for number, what in enumerate(HIDDEN)
    ],
)
def test_what_is_hidden_is_left_out_and_the_rest_keeps_its_index(
    draw_grid: Draw, what: str, view: dict[str, Any]
) -> None:
    corners_mm, hidden = HIDDEN[what]
    picture = draw_grid(**view, focal_px=1350.0)
    grid = find_grid(_covered(picture, corners_mm))
    outline = _placed(picture, corners_mm).astype(np.float32)

    assert 441 - hidden - 8 <= grid.found <= 441 - hidden
    assert all(cv2.pointPolygonTest(outline, (float(u), float(v)), True) < 1 for u, v in grid.uv_px)
    assert np.median(picture.errors_px(grid)) < 0.01
    assert picture.errors_px(grid).max() < 0.15


@pytest.mark.parametrize("side", [0, 1, 2, 3])
@pytest.mark.parametrize(
    "view", [pytest.param({}, marks=pytest.mark.extended), {"pan_deg": 25, "roll_deg": -20}], ids=str
)
def test_an_outer_line_that_is_wholly_hidden_is_not_guessed(
    draw_grid: Draw, view: dict[str, Any], side: int
) -> None:
    strip = np.array(_rectangle(4.8, -6, 6, 6))
    turn = np.array([[0, -1], [1, 0]])
    hidden = strip @ np.linalg.matrix_power(turn, side)
    image = _covered(draw_grid(focal_px=1350.0, **view), [tuple(corner) for corner in hidden])

    with pytest.raises(CalibrationError, match=r"got 2[01] × 2[01] lines"):
        find_grid(image)


def test_a_line_too_many_is_not_overlooked_because_it_is_hidden_in_part(draw_grid: Draw) -> None:
    picture = draw_grid(lines=(22, 21), focal_px=1250.0)

    with pytest.raises(CalibrationError, match="got 22 × 21 lines"):
        find_grid(_covered(picture, _rectangle(5.1, -6, 6, 1)))


@pytest.mark.parametrize("dark_lines", [True, pytest.param(False, marks=pytest.mark.extended)])
def test_light_that_falls_to_a_third_does_not_shift_lines(draw_grid: Draw, dark_lines: bool) -> None:
    picture = draw_grid(noise=0, line_mm=0.08, dark=20, roll_deg=3, dark_lines=dark_lines)
    fall = np.linspace(1, 1 / 3, picture.image.shape[1], dtype=np.float32)
    error_px = picture.errors_px(find_grid(picture.image * fall))

    # uncorrected, dark lines would lie 0.007 px off
    assert np.sqrt(np.mean(error_px**2)) < 0.003


def test_a_glare_spot_costs_points_or_hundredths_of_a_pixel_beside_it(draw_grid: Draw) -> None:
    picture = draw_grid(pan_deg=20)
    row, column = np.mgrid[:450, :450]
    glare = 300 * np.exp(-((row - 200) ** 2 + (column - 250) ** 2) / (2 * 20**2))
    grid = find_grid(np.minimum(picture.image + glare, 255).astype(np.float32))

    assert grid.found >= 0.95 * 441
    assert np.median(picture.errors_px(grid)) < 0.01
    assert picture.errors_px(grid).max() < 0.15


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_whatever_hides_it_and_however_it_is_lit_no_index_is_wrong(draw_grid: Draw, seed: int) -> None:
    """Covers of every size and place, dust, fibres and fading light: found right, or refused."""
    rng = np.random.default_rng(seed)
    refused = 0
    for _ in range(40):
        pan, tilt = rng.uniform(-32, 32, 2)
        view = {"pan_deg": pan, "tilt_deg": tilt, "roll_deg": rng.uniform(-30, 30), "focal_px": 1200.0}
        picture = draw_grid(**view, line_mm=rng.uniform(0.04, 0.15), seed=int(rng.integers(1e6)))
        middle, size = rng.uniform(-6, 6, 2), rng.uniform(0.2, 2.0, 2)
        corners = _rectangle(*(middle - size), *(middle + size))
        image = _covered(picture, corners, float(rng.uniform(0, 255)))
        for _ in range(30):
            place = tuple(int(value) for value in rng.integers(20, 430, 2))
            cv2.circle(image, place, int(rng.integers(1, 5)), float(rng.uniform(0, 255)), -1)
        image *= np.linspace(1, rng.uniform(0.33, 1), image.shape[1], dtype=np.float32)
        try:
            grid = find_grid(image)
        except CalibrationError:
            refused += 1
            continue
        assert np.median(picture.errors_px(grid)) < 0.03, (seed, view)
        assert picture.errors_px(grid).max() < 0.5, (seed, view)
    assert refused < 20
