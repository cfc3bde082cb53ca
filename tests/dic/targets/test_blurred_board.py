"""Blurred checkerboards are either measured or refused."""

import numpy as np
import pytest
from scipy.special import erf

from dic.errors import CalibrationError
from dic.targets.find import find_target
from dic.targets.kinds import CheckerboardTarget

SQUARES = (9, 7)


def _blurred_wave(x_px: np.ndarray, edges_px: np.ndarray, blur_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return two blurred waves: 1 between the outermost edges, and ±1 alternating between the edges."""
    steps = (1 + erf((x_px[..., None] - edges_px) / (np.sqrt(2) * blur_px))) / 2
    between = steps[..., :-1] - steps[..., 1:]
    return between.sum(axis=-1), between @ (-1.0) ** np.arange(len(edges_px) - 1)


def _board(blur_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the image of a board of 9 × 7 squares of 50 px, and its corners (n, 2), px.

    If a pattern f(x) g(y) is blurred by a normal distribution, the result is the product of the blurred f and
    the blurred g, for any directions of x and y.
    """
    y, x = np.mgrid[:480, :560]
    centre, turn = np.array([283.3, 238.3]), np.deg2rad(12.0)
    along = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    places = (np.stack([x, y], axis=-1) - centre) @ along.T
    edges = [(np.arange(count + 1) - count / 2) * 50.0 for count in SQUARES]
    (inside_x, wave_x), (inside_y, wave_y) = (
        _blurred_wave(places[..., axis], edges[axis], blur_px) for axis in (0, 1)
    )
    dark = (inside_x * inside_y - wave_x * wave_y) / 2
    corners = np.stack(np.meshgrid(edges[0][1:-1], edges[1][1:-1]), axis=-1).reshape(-1, 2)
    noise = np.random.default_rng(3).normal(0, 3, dark.shape)
    return np.rint(200 - 160 * dark + noise).astype(np.float32), corners @ along + centre


def test_corners_of_a_blurred_board_are_measured() -> None:
    image, corners = _board(blur_px=2.0)
    found = find_target(image, CheckerboardTarget(SQUARES, 1.0))
    away = np.linalg.norm(found.uv_px[:, None] - corners, axis=-1).min(axis=1)

    assert found.found == len(corners)
    assert np.sqrt((away**2).mean()) < 0.03


@pytest.mark.extended
def test_a_board_with_too_much_blur_for_a_measurement_is_refused() -> None:
    with pytest.raises(CalibrationError, match="corners are sharp enough; check that it is sharp"):
        find_target(_board(blur_px=12.0)[0], CheckerboardTarget(SQUARES, 1.0))
