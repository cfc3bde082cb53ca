"""Tests of ChArUco boards that are small, drawn by older programs, partly covered, or seen obliquely."""

import numpy as np
import pytest

from dic.calibration.grid_making import GridAccuracy
from dic.calibration.pinhole.prior import KnownCamera
from dic.errors import CalibrationError
from dic.pipeline.target_images import calibrate_images
from dic.targets.find import find_target
from dic.targets.kinds import CharucoTarget, LineGridTarget
from tests.dic.targets.drawings import FOCAL_PX, View, charuco

SMALLEST = CharucoTarget((3, 3), 2.0, 1.5)


def test_the_smallest_board_is_found() -> None:
    view = View.of(charuco(SMALLEST), roll_deg=25.0, size_px=(360, 360), pan_deg=30.0)
    grid = find_target(view.image(), SMALLEST)

    assert grid.found == 4
    assert view.rms_px(grid) < 0.02


@pytest.mark.parametrize("off_deg", [pytest.param(0.0, marks=pytest.mark.extended), 20.0])
def test_edges_without_blur_do_not_pull_corners_towards_the_pixels(off_deg: float) -> None:
    """Grey levels that are interpolated between pixels are wrong beside such edges, here by 0.07 px."""
    target = CharucoTarget((10, 9), 1.0, 0.7)
    view = View.of(charuco(target), roll_deg=0.5, pan_deg=off_deg)
    image = view.image(noise=0.0, blur_px=0.0)
    known, made = KnownCamera(focal_px=FOCAL_PX), GridAccuracy("exact")
    calibration = calibrate_images(image, target, known=known, accuracy=made)
    camera = calibration.pinhole

    assert view.rms_px(calibration.grid) < 0.01
    assert camera is not None
    assert abs(camera.off_axis_deg - off_deg) < 3 * camera.off_axis_std_deg < 1.0


@pytest.mark.parametrize("rows", [pytest.param(5, marks=pytest.mark.extended), 6])
def test_boards_drawn_by_older_versions_of_opencv_are_found(rows: int) -> None:
    """Before version 4.6, a board with an even number of rows began with a bright square."""
    target = CharucoTarget((5, rows), 1.5, 1.1, "DICT_6X6_250")
    view = View.of(charuco(target, legacy=True), roll_deg=-10.0, size_px=(480, 480), tilt_deg=20.0)
    grid = find_target(view.image(), target)

    assert grid.found == grid.expected
    assert view.rms_px(grid) < 0.02


@pytest.mark.parametrize(
    ("squares", "first"), [((5, 6), 40), ((5, 5), 7), pytest.param((4, 7), 3, marks=pytest.mark.extended)]
)
def test_board_whose_markers_begin_with_another_number_is_found_and_advised(squares, first) -> None:
    target = CharucoTarget(squares, 1.5, 1.1)
    view = View.of(charuco(target, first=first), roll_deg=15.0, size_px=(480, 480), tilt_deg=20.0)
    grid = find_target(view.image(), target)
    assert grid.found == grid.expected
    assert view.rms_px(grid) < 0.02
    if first > squares[0]:
        with pytest.raises(CalibrationError, match=f"--squares {squares[0]}x{squares[1]} "):
            find_target(view.image(), LineGridTarget((9, 9), 1.0))


def test_board_with_other_first_numbers_and_hidden_rows_could_be_shifted_and_is_refused() -> None:
    larger = CharucoTarget((6, 8), 1.2, 0.9)
    view = View.of(charuco(larger, first=60), size_px=(480, 480))
    with pytest.raises(
        CalibrationError, match=r"got the markers 60 to 83 of a board .* first and its last marker"
    ):
        find_target(view.image(), CharucoTarget((6, 10), 1.2, 0.9))


def test_markers_of_another_dictionary_are_named() -> None:
    view = View.of(charuco(CharucoTarget((5, 6), 1.5, 1.1, "DICT_6X6_250")), size_px=(480, 480))

    with pytest.raises(CalibrationError, match=r"but a ChArUco board .* with markers of DICT_6X6_50;"):
        find_target(view.image(), CharucoTarget((5, 6), 1.5, 1.1, "DICT_4X4_50"))


@pytest.mark.extended
@pytest.mark.parametrize("rows", [6, pytest.param(7, marks=pytest.mark.extended)])
def test_a_part_of_a_larger_board_is_not_taken_for_the_board(rows: int) -> None:
    """Boards of as many columns have the same markers in the same places, but another middle."""
    larger = CharucoTarget((6, rows), 1.2, 0.9)
    view = View.of(charuco(larger), roll_deg=5.0, size_px=(480, 480), pan_deg=20.0)

    with pytest.raises(
        CalibrationError, match=f"a larger board.*, but a ChArUco board of 6 × {rows} squares"
    ):
        find_target(view.image(), CharucoTarget((6, 5), 1.2, 0.9))


@pytest.mark.long
def test_boards_from_three_by_three_are_found_in_forty_views() -> None:
    rng = np.random.default_rng(3)
    found, errors_px = 0, []
    for number in range(40):
        squares = (int(rng.integers(3, 9)), int(rng.integers(3, 9)))
        side_mm = 9.0 / max(squares)
        dictionary = str(rng.choice(["DICT_4X4_100", "DICT_5X5_100", "DICT_6X6_250"]))
        target = CharucoTarget(squares, side_mm, float(rng.choice([0.6, 0.7, 0.8])) * side_mm, dictionary)
        off_deg, towards = rng.uniform(0, 45), rng.uniform(0, 2 * np.pi)
        view = View.of(
            charuco(target, legacy=number % 3 == 0),
            rng.uniform(-180, 180),
            (640, 640),
            1700.0,
            pan_deg=off_deg * np.cos(towards),
            tilt_deg=off_deg * np.sin(towards),
        )
        try:
            grid = find_target(view.image(6.0, rng.uniform(0.6, 1.5), number, float(number % 2) * 50), target)
        except CalibrationError as error:
            print(number, squares, dictionary, f"{off_deg:.0f}°", error)
            continue
        found += 1
        errors_px.append(view.rms_px(grid))
    print(f"found {found} of 40, rms {np.median(errors_px):.3f} px, at most {max(errors_px):.3f} px")

    assert found >= 38
    assert np.median(errors_px) < 0.05
    assert max(errors_px) < 0.2
