import numpy as np
import pytest

from dic.calibration.bicubic import BicubicMap
from dic.errors import CalibrationError


def _lattice(count: int = 6) -> np.ndarray:
    line = np.linspace(100, 800, count)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def _surface(px: np.ndarray) -> np.ndarray:
    x, y = (px / 400 - 1).T
    return np.column_stack([2 * x + 0.3 * x**3 * y**3 - 1, y - 0.2 * x**2 * y**3 + 0.1 * x**3 + 0.5])


def test_any_bicubic_surface_is_reproduced_everywhere() -> None:
    px = _lattice()
    bicubic = BicubicMap.fit(px, _surface(px))
    elsewhere = np.random.default_rng(1).uniform(0, 1000, (200, 2))

    assert bicubic.map(elsewhere) == pytest.approx(_surface(elsewhere), abs=1e-10)


def test_the_fit_survives_a_distant_origin() -> None:
    px = _lattice()
    far = np.array([1e5, -2e5])
    bicubic = BicubicMap.fit(px + far, _surface(px))

    assert bicubic.map(px + far) == pytest.approx(_surface(px), abs=1e-9)


def test_the_jacobian_is_the_map_s_derivative() -> None:
    px = _lattice()
    bicubic = BicubicMap.fit(px, _surface(px))
    at, step = np.array([[333.0, 444.0]]), 0.01
    by_x = bicubic.map(at + step * np.array([1, 0])) - bicubic.map(at - step * np.array([1, 0]))
    by_y = bicubic.map(at + step * np.array([0, 1])) - bicubic.map(at - step * np.array([0, 1]))

    assert bicubic.jacobian(at)[0] == pytest.approx(
        np.column_stack([by_x[0], by_y[0]]) / (2 * step), rel=1e-6
    )


def test_least_squares_average_noise_down() -> None:
    px = _lattice(21)
    noise = np.random.default_rng(2).normal(0, 1e-3, px.shape)
    error = BicubicMap.fit(px, _surface(px) + noise).map(px) - _surface(px)

    # sixteen parameters from 441 points leave σ·sqrt(16/441) in the mean
    assert np.sqrt((error**2).mean()) == pytest.approx(1e-3 * np.sqrt(16 / 441), rel=0.35)


def test_a_place_that_is_not_a_number_is_mapped_to_none() -> None:
    px = _lattice()

    assert np.isnan(BicubicMap.fit(px, _surface(px)).map(np.array([[np.nan, 3.0]]))).all()


@pytest.mark.parametrize("px", [_lattice(4)[:15], _lattice(6)[:18], _lattice(6) * [0, 1]])
def test_points_that_do_not_determine_sixteen_parameters_are_refused(px: np.ndarray) -> None:
    with pytest.raises(CalibrationError, match="sixteen parameters"):
        BicubicMap.fit(px, _surface(px))
