"""Checkerboards with squares of about twelve pixels are found more accurately than by OpenCV."""

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from dic.errors import CalibrationError
from dic.targets.find import find_target
from dic.targets.kinds import CheckerboardTarget
from tests.dic.targets.drawings import View, checkerboard

SQUARES = (12, 9)
TARGET = CheckerboardTarget(SQUARES, 1.0)
CORNERS_MM = np.stack(np.meshgrid(np.arange(11) - 5.0, np.arange(8) - 3.5), axis=-1).reshape(-1, 2)


def _opencv_rms_px(view: View, image: np.ndarray) -> float | None:
    """Return the rms error of OpenCV's sector-based finder, px, or None if it finds no board."""
    flags = cv2.CALIB_CB_EXHAUSTIVE
    for flag in (0, flags, flags | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE):
        found, corners = cv2.findChessboardCornersSB(image.astype(np.uint8), (11, 8), flags=flag)
        if found:
            away, _ = KDTree(view.project(CORNERS_MM)).query(corners.reshape(-1, 2))
            return float(np.sqrt((away**2).mean()))
    return None


def _view(rng: np.random.Generator) -> tuple[View, np.ndarray]:
    square_px = rng.uniform(9, 14)
    view = View.of(
        checkerboard(SQUARES, 1.0),
        rng.uniform(-40, 40),
        (320, 280),
        square_px * 40,
        pan_deg=rng.uniform(-40, 40),
    )
    return view, view.image(float(rng.choice([2.0, 6.0])), rng.uniform(0.6, 1.3), int(rng.integers(1000)))


def _compare(views: int, seed: int) -> tuple[int, int, int]:
    """Return the numbers of boards found by `dic`, found by OpenCV, and measured better by OpenCV."""
    rng = np.random.default_rng(seed)
    found, by_opencv, better = 0, 0, 0
    for _ in range(views):
        view, image = _view(rng)
        theirs = _opencv_rms_px(view, image)
        by_opencv += theirs is not None
        try:
            ours = view.rms_px(find_target(image, TARGET))
        except CalibrationError:
            ours = np.inf
        found += np.isfinite(ours)
        better += theirs is not None and theirs < ours
    return found, by_opencv, better


@pytest.mark.extended
def test_small_squares_are_found_and_measured_better_than_by_opencv() -> None:
    found, by_opencv, better = _compare(4, seed=1)

    assert found == 4
    assert by_opencv > 0
    assert better == 0


@pytest.mark.extended
def test_the_ends_of_the_squares_at_the_rim_are_no_corners() -> None:
    """In this view OpenCV's finder takes the rim for a row of corners and leaves a true row out."""
    view = View.of(checkerboard((12, 11), 0.9), 8.0, pan_deg=30.0)
    image = view.image(noise=6.0)
    grid = find_target(image, CheckerboardTarget((12, 11), 0.9))

    assert grid.found == 110
    assert view.rms_px(grid) < 0.03
    # The picture may cut the squares at the rim: only the corners must be in view.
    cut = find_target(image[60:480, 95:490], CheckerboardTarget((12, 11), 0.9))
    assert np.abs(cut.uv_px + np.array([95, 60]) - grid.uv_px).max() < 0.2


def test_a_part_of_a_larger_board_is_not_taken_for_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV's finder sometimes finds 12 × 11 of the 13 × 11 squares of a board."""
    view = View.of(checkerboard((13, 11), 0.8), -12.0, (500, 430), 1350.0, pan_deg=10.0)
    image = view.image()
    part_mm = np.stack(np.meshgrid(np.arange(11) - 5.5, 4.5 - np.arange(10)), axis=-1).reshape(-1, 2) * 0.8
    part_px = view.project(part_mm).astype(np.float32)[:, None]
    monkeypatch.setattr(cv2, "findChessboardCornersSB", lambda image, lines, flags: (True, part_px))

    with pytest.raises(CalibrationError, match="no such board, but a checkerboard of 13 × 11 squares"):
        find_target(image, CheckerboardTarget((12, 11), 0.8))


@pytest.mark.long
def test_no_board_that_opencv_finds_is_lost() -> None:
    found, by_opencv, better = _compare(60, seed=5)
    print(f"found {found}, by OpenCV {by_opencv}, with a smaller error {better}")

    assert found >= by_opencv
    assert better == 0
