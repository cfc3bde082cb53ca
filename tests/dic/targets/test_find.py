"""Tests of checkerboards, ChArUco boards and dots, drawn as the simulators' camera sees them."""

import cv2
import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.targets.find import find_target
from dic.targets.kinds import CharucoTarget, CheckerboardTarget, DotTarget, LineGridTarget, Target
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid
from tests.dic.targets.drawings import FOCAL_PX, SIZE_PX, Drawing, charuco, checkerboard, dots, seen


def _rms(grid: GridPoints, camera: PinholeCamera, surface: Surface) -> float:
    error_px = grid.uv_px - camera.project(surface.world(grid.xy_mm))
    return float(np.sqrt((error_px**2).sum(axis=1).mean()))


BOARD = CheckerboardTarget((12, 11), 0.9)
CHARUCO = CharucoTarget((10, 9), 1.0, 0.7)
DOTS = DotTarget((13, 12), 0.8)


@pytest.mark.parametrize(
    "roll_deg", [50.0, *(pytest.param(deg, marks=pytest.mark.long) for deg in (173.0, 275.0))]
)
@pytest.mark.parametrize(
    ("target", "drawing", "limit_px"),
    [
        pytest.param(BOARD, checkerboard((12, 11), 0.9), 0.015, marks=pytest.mark.extended),
        (CHARUCO, charuco(CHARUCO), 0.015),
    ],
    ids=["checkerboard", "ChArUco"],
)
def test_boards_that_are_not_symmetric_name_their_axes_themselves(
    target: Target, drawing: Drawing, limit_px: float, roll_deg: float
) -> None:
    image, camera, surface = seen(drawing, roll_deg=roll_deg, pan_deg=25.0)
    grid = find_target(image, target)

    assert grid.orientation == "mark"
    assert grid.found == grid.expected
    assert _rms(grid, camera, surface) < limit_px


@pytest.mark.parametrize("squares", [(12, 12), pytest.param((12, 10), marks=pytest.mark.extended)])
def test_a_symmetric_board_follows_the_image_or_the_option(squares: tuple[int, int]) -> None:
    image, camera, surface = seen(checkerboard(squares, 0.85), roll_deg=10.0)
    target = CheckerboardTarget(squares, 0.85)
    assumed, turned = find_target(image, target), find_target(image, target, x_axis="left")

    assert (assumed.orientation, turned.orientation) == ("assumed", "option")
    assert _rms(assumed, camera, surface) < 0.03
    assert _rms(turned, camera, Surface(surface.texture, _half_turn(surface))) < 0.03


def _half_turn(surface: Surface) -> Pose:
    return surface.pose.after(Pose.turned(np.array([0.0, 0.0, 1.0]), 180.0, np.zeros(3)))


@pytest.mark.parametrize(
    "swing",
    [
        {"pan_deg": 30.0, "tilt_deg": -30.0},
        *(pytest.param(swing, marks=pytest.mark.extended) for swing in ({}, {"pan_deg": 30.0})),
    ],
    ids=str,
)
def test_dots_are_found_where_their_centres_are(swing: dict[str, float]) -> None:
    image, camera, surface = seen(dots((13, 12), 0.8, 0.2), roll_deg=8.0, **swing)
    grid = find_target(image, DOTS)

    assert grid.found == 156
    assert grid.orientation == "assumed"
    assert _rms(grid, camera, surface) < 0.03


@pytest.mark.extended
def test_large_dots_are_not_shifted_by_perspective() -> None:
    """Uncorrected, ``u = f x cos θ/(D − x sin θ)`` puts centroids of 0.3 mm dots about 0.04 px off at 40°.

    Mean of u over the disc, weighted by its area in the image ``∝ D³/(D − x sin θ)³``, to second order:
    ``(r²/4)(u''/2 + 3 u' sin θ/D)`` with ``u' = f cos θ/D`` and ``u'' = 2 f sin θ cos θ/D²``.
    """
    image, camera, surface = seen(dots((11, 10), 0.95, 0.3), noise=0.0, pan_deg=40.0)
    grid = find_target(image, DotTarget((11, 10), 0.95))
    sin, cos = np.sin(np.radians(40)), np.cos(np.radians(40))
    shift_px = 0.3**2 / 4 * (1 + 3) * FOCAL_PX * sin * cos / 40**2
    error_px = grid.uv_px - camera.project(surface.world(grid.xy_mm))

    assert shift_px > 0.04
    assert abs(error_px[:, 0].mean()) < shift_px / 10


@pytest.mark.extended
def test_a_board_with_markers_may_be_covered_to_a_half() -> None:
    image, camera, surface = seen(charuco(CHARUCO), roll_deg=20.0)
    covered = image.copy()
    hidden = np.array([[-0.7, -0.7], [6, -0.7], [6, 6], [-0.7, 6]])
    cv2.fillPoly(covered, [camera.project(surface.world(hidden)).astype(np.int32)], 120.0)
    grid = find_target(covered, CHARUCO)

    assert 36 <= grid.found <= 50
    assert _rms(grid, camera, surface) < 0.02
    cv2.fillPoly(covered, [camera.project(surface.world(hidden * [1, 1.0] - [7, 0])).astype(np.int32)], 120.0)
    with pytest.raises(CalibrationError, match="at least half of the 72 corners"):
        find_target(covered, CHARUCO)


def test_hidden_dots_are_left_out_up_to_a_tenth() -> None:
    image, camera, surface = seen(dots((13, 12), 0.8, 0.2), roll_deg=8.0, pan_deg=20.0)
    covered = image.copy()
    hidden = np.array([[0.5, 0.5], [2.7, 0.5], [2.7, 2.7], [0.5, 2.7]])
    cv2.fillPoly(covered, [camera.project(surface.world(hidden)).astype(np.int32)], 120.0)
    grid = find_target(covered, DOTS)

    assert 141 <= grid.found <= 150
    assert _rms(grid, camera, surface) < 0.03


def test_the_line_grid_is_found_through_the_same_function() -> None:
    image, camera, surface = seen(LineGrid(), roll_deg=3.0)
    grid = find_target(image, LineGridTarget(), x_axis="right")

    assert grid.found == 441
    assert grid.orientation == "option"
    assert _rms(grid, camera, surface) < 0.01


@pytest.mark.parametrize(
    "target",
    [
        CHARUCO,
        # `test_seen.py` and the next test ask for a board and for dots.
        *(
            pytest.param(target, marks=pytest.mark.extended)
            for target in (BOARD, DOTS, CheckerboardTarget((13, 11), 0.9))
        ),
    ],
    ids=str,
)
@pytest.mark.parametrize("picture", [pytest.param("noise", marks=pytest.mark.long), "another target"])
def test_what_is_not_the_target_is_refused(target: Target, picture: str) -> None:
    if picture == "noise":
        image = np.random.default_rng(2).normal(128, 30, (SIZE_PX, SIZE_PX)).astype(np.float32)
    else:
        image = seen(LineGrid())[0]

    with pytest.raises(CalibrationError, match="expected"):
        find_target(image, target)


@pytest.mark.extended
def test_the_cells_of_a_line_grid_are_not_taken_for_dots() -> None:
    with pytest.raises(
        CalibrationError, match=r"got regions that are not round.*, but a line grid of 21 × 21 lines"
    ):
        find_target(seen(LineGrid(), roll_deg=8.0)[0], DotTarget((20, 20), 0.5))


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        (CheckerboardTarget((4, 11), 0.9), "number of squares: .* got 4 × 11"),
        (DotTarget((13, 12), 0.0), "pitch: .* got 0 mm"),
        (CharucoTarget((10, 9), 1.0, 1.0), "side of a marker: .* got 1 mm"),
        (CharucoTarget((10, 9), 1.0, 0.7, "DICT_UNKNOWN"), "a dictionary of OpenCV, got DICT_UNKNOWN"),
    ],
    ids=str,
)
def test_a_target_that_cannot_be_is_refused(target: Target, sentence: str) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        find_target(np.zeros((100, 100), np.float32), target)


def test_all_mistakes_in_a_target_are_reported_together() -> None:
    with pytest.raises(CalibrationError) as caught:
        find_target(np.zeros((100, 100), np.float32), CharucoTarget((2, 9), 1.0, 2.0, "DICT_UNKNOWN"))

    for option in ("--squares 3x9", "--marker-mm 0.7", "--dictionary DICT_5X5_100"):
        assert f"; give {option}" in str(caught.value)
