"""`dic calibrate` with targets other than a grid of lines."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.image_files import write_image

SQUARES, SIDE_PX, MARGIN_PX = (10, 7), 48, 60


def board(folder: Path) -> Path:
    """Write an image of a checkerboard seen from the front, whose corners have known pixel coordinates."""
    columns, rows = SQUARES
    dark = (np.add.outer(np.arange(rows), np.arange(columns)) + rows - 1) % 2 == 0
    squares = np.where(np.kron(dark, np.ones((SIDE_PX, SIDE_PX), bool)), 40, 220).astype(np.uint8)
    picture = np.pad(squares, MARGIN_PX, constant_values=220)
    return write_image(folder / "board.png", cv2.GaussianBlur(picture, (0, 0), 1.0))


def test_a_checkerboard_is_named_by_its_squares(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    done = run_dic("calibrate", board(tmp_path), "--squares", "10x7", "--pitch-mm", 2, "--points", points)
    assert done.status == 0
    X_mm, Y_mm, u_px, v_px = np.loadtxt(points, delimiter=",", skiprows=1).T
    assert len(X_mm) == 9 * 6
    # A corner lies between pixels, half a pixel before the first one of its square.
    np.testing.assert_allclose(u_px, MARGIN_PX - 0.5 + (X_mm / 2 + 5) * SIDE_PX, atol=0.02)
    np.testing.assert_allclose(v_px, MARGIN_PX - 0.5 + (3.5 - Y_mm / 2) * SIDE_PX, atol=0.02)


@pytest.mark.extended
def test_a_charuco_board_and_dots_are_named_by_theirs(tmp_path: Path) -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    charuco = cv2.aruco.CharucoBoard((8, 6), 1.0, 0.7, dictionary).generateImage((800, 600), marginSize=40)
    lattice = np.full((600, 800), 220, np.uint8)
    for x in range(9):
        for y in range(7):
            cv2.circle(lattice, (100 + 70 * x, 90 + 70 * y), 20, 40, -1, cv2.LINE_AA)
    for name, picture, options, expected in (
        ("charuco", charuco, ("--squares", "8x6", "--marker-mm", 0.35), 7 * 5),
        ("dots", lattice, ("--dots", "9x7"), 9 * 7),
    ):
        path = write_image(tmp_path / f"{name}.png", cv2.GaussianBlur(picture, (0, 0), 1.0))
        done = run_dic("calibrate", path, *options, "--json", tmp_path / f"{name}.json")
        assert done.report["found"] == expected


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--squares", "10x7", "--dots", "9x7"), "got --squares and --dots"),
        (("--dots", "10x7", "--asymmetric-dots", "4x11"), "got --dots and --asymmetric-dots; leave out"),
        (("--marker-mm", "0.3"), "name the board's squares"),
        (("--squares", "10x7", "--origin-px", 1, 1), "leave out --origin-px"),
    ],
)
def test_targets_that_make_no_sense_are_refused(
    tmp_path: Path,
    options: tuple[object, ...],
    sentence: str,
) -> None:
    assert sentence in refusal("calibrate", board(tmp_path), *options)
