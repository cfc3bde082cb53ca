"""If an image shows another target than the given one, the error message names the shown target."""

from functools import cache

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from dic.errors import CalibrationError
from dic.targets.find import find_target
from dic.targets.kinds import CharucoTarget, CheckerboardTarget, DotTarget, LineGridTarget, Target
from dic.targets.seen import target_seen
from simulators.scene.texture import LineGrid
from tests.dic.targets.drawings import HollowDots, View, charuco, checkerboard, dots

BOARD = CharucoTarget((8, 6), 1.2, 0.9, "DICT_4X4_100")
OLD_BOARD = CharucoTarget((5, 6), 1.5, 0.9, "DICT_6X6_250")
SHOWN = {
    "checkerboard": (checkerboard((13, 11), 0.8), "a checkerboard of 13 × 11 squares"),
    "small checkerboard": (checkerboard((5, 4), 2.0), "a checkerboard of 5 × 4 squares"),
    "ChArUco": (charuco(BOARD), "a ChArUco board of 8 × 6 squares with markers of DICT_4X4_50"),
    "old ChArUco": (
        charuco(OLD_BOARD, legacy=True),
        "a ChArUco board of 5 × 6 squares with markers of DICT_6X6_50",
    ),
    "line grid": (LineGrid(), "a line grid of 21 × 21 lines"),
    "dots": (dots((13, 12), 0.8, 0.2), "a lattice of 13 × 12 dots"),
    "plate with marks": (HollowDots((-6, -6), (6, 6), 0.8, 0.2, 0.1, (4, 4)), "a lattice of 13 × 13 dots"),
}


@cache
def _image(shown: str) -> np.ndarray:
    return View.of(SHOWN[shown][0], roll_deg=8.0, pan_deg=20.0).image(noise=4.0)


# The requests below for other targets name the other ones.
@pytest.mark.parametrize(
    "shown",
    [
        pytest.param(
            each, marks=() if each in ("small checkerboard", "old ChArUco") else pytest.mark.extended
        )
        for each in SHOWN
    ],
)
def test_the_target_in_the_image_is_named_with_its_numbers(shown: str) -> None:
    assert str(target_seen(_image(shown))) == SHOWN[shown][1]


@pytest.mark.parametrize(
    ("asked", "shown", "options"),
    [
        pytest.param(
            CheckerboardTarget((12, 11), 0.9), "line grid", "--lines 21x21", marks=pytest.mark.extended
        ),
        pytest.param(CharucoTarget((10, 9), 1.0, 0.7), "dots", "--dots 13x12", marks=pytest.mark.long),
        (CharucoTarget((10, 9), 1.0, 0.7), "ChArUco", "--squares 8x6 --marker-mm … --dictionary DICT_4X4_50"),
        (LineGridTarget((12, 11), 0.8), "dots", "--dots 13x12"),
        pytest.param(DotTarget((12, 10), 0.8), "checkerboard", "--squares 13x11", marks=pytest.mark.long),
    ],
    ids=str,
)
def test_a_request_for_another_target_says_what_is_seen(asked: Target, shown: str, options: str) -> None:
    said = f", but {SHOWN[shown][1]}; for that target give {options}, otherwise"

    with pytest.raises(CalibrationError, match=said):
        find_target(_image(shown), asked)


def test_an_image_of_another_target_is_refused_without_the_longest_searches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In 5 megapixels the fit of 400 cells takes 4 s, and the search for markers on a board 1 s."""

    def not_needed(*_: object) -> None:
        raise AssertionError("this search takes long and is not needed")

    monkeypatch.setattr("dic.targets.dot_lattice.fit_ellipses", not_needed)
    monkeypatch.setattr("dic.targets.seen.markers_seen", not_needed)

    with pytest.raises(CalibrationError, match=r"regions that are not round.* a checkerboard of 13 × 11"):
        find_target(_image("checkerboard"), DotTarget((10, 8), 0.8))


@pytest.mark.long
def test_a_large_image_is_named_as_well_as_a_small_one() -> None:
    large = cv2.resize(_image("checkerboard"), None, fx=2.5, fy=2.5, interpolation=cv2.INTER_CUBIC)

    assert str(target_seen(large)) == "a checkerboard of 13 × 11 squares"


def test_what_is_no_target_gets_no_name() -> None:
    rng = np.random.default_rng(4)
    stripes = 60 + 140.0 * (np.mgrid[:400, :400][0] % 20 > 3)
    pictures = [np.full((300, 300), 128.0), rng.normal(128, 30, (400, 400)), stripes]
    for width_px in (1.5, 3.0, 6.0):
        speckle = gaussian_filter(rng.normal(size=(500, 500)), width_px)
        pictures.append(128 + 50 * speckle / speckle.std())

    assert [target_seen(picture.astype(np.float32)) for picture in pictures] == [None] * len(pictures)
