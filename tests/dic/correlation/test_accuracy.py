"""Accuracy compared with theory: interpolation bias, noise (Cramér-Rao bound), and spatial resolution."""

import numpy as np
import pytest

from benchmarks.accuracy import interpolation_bias, noise, read_star, star_resolution
from benchmarks.speckle import Speckle, gentle_strain, truth
from benchmarks.theory import cramer_rao_px, resolution_px, slopes
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings


@pytest.fixture(scope="module")
def pattern() -> Speckle:
    return Speckle(seed=4, shape=(320, 320))


@pytest.mark.parametrize(
    ("order", "limit_px"), [pytest.param(3, 1e-3, marks=pytest.mark.extended), (5, 1e-4)]
)
def test_subpixel_shifts_of_a_noiseless_pattern_are_not_biased(order, limit_px):
    found = interpolation_bias(
        Speckle(seed=3, shape=(160, 160)), CorrelationSettings(subset_px=21, step_px=7, order=order)
    )
    assert found.bias_px < limit_px


@pytest.mark.parametrize(
    ("shape", "order"),
    [
        ("quadratic", 5),
        *(
            pytest.param(*case, marks=pytest.mark.extended)
            for case in (("affine", 3), ("affine", 5), ("quadratic", 3))
        ),
    ],
)
def test_scatter_is_the_cramer_rao_bound_and_what_points_predict(pattern, shape, order):
    settings = CorrelationSettings(subset_px=21, step_px=11, shape=shape, order=order)
    found = noise(pattern, settings, grey_levels=2.0)
    assert found.observed_px == pytest.approx(found.bound_px, rel=0.1)
    assert found.predicted_px == pytest.approx(found.observed_px, rel=0.15)


def test_strong_noise_does_not_draw_a_shift_towards_whole_or_half_pixels(pattern):
    settings = CorrelationSettings(subset_px=31, step_px=8, shape="affine", min_zncc=0.3)
    found = noise(pattern, settings, grey_levels=8.0, pairs=8)
    assert found.bias_px < 3e-3
    # A bias of this size would be found: 3 mpx are three standard errors of the mean of all subsets.
    independent = 8 * (pattern.shape[0] - 80) ** 2 / settings.subset_px**2
    assert found.observed_px / np.sqrt(independent) < 1.1e-3


def test_the_bound_is_reached_by_least_squares_with_the_true_slopes(pattern):
    picture, gradient = pattern.draw(), slopes(pattern)
    r = 10
    here = np.s_[160 - r : 160 + r + 1, 160 - r : 160 + r + 1]
    f, fx, fy = (a[here].ravel() for a in (picture, *gradient))
    y, x = np.mgrid[-r : r + 1, -r : r + 1].reshape(2, -1)
    design = np.stack([fx, fx * x, fx * y, fy, fy * x, fy * y, np.ones_like(f), f], axis=1)
    difference = np.random.default_rng(0).normal(0, np.sqrt(2), (len(f), 4000))
    scatter = np.linalg.lstsq(design, difference, rcond=None)[0].std(axis=1)
    bound = cramer_rao_px(picture, gradient, np.array([[160, 160]]), 21, "affine")[0]
    np.testing.assert_allclose(scatter[[0, 3]], bound, rtol=0.04)


@pytest.mark.parametrize(
    ("shape", "known_px"),
    [("affine", [35.7, 67.8, 83.8, 123.7]), ("quadratic", [11.3, 21.8, 27.0, 40.0])],
)
def test_the_theory_of_resolution_gives_the_known_periods(shape, known_px):
    found = [resolution_px(subset, shape) for subset in (9, 17, 21, 31)]
    np.testing.assert_allclose(found, known_px, atol=0.06)


@pytest.mark.parametrize(
    ("shape", "subset_px"),
    [
        *(("affine", 17), ("quadratic", 21)),
        *(
            pytest.param(*case, marks=pytest.mark.extended)
            for case in (("quadratic", 17), ("affine", 21), ("affine", 31), ("quadratic", 31))
        ),
    ],
)
def test_the_star_keeps_nine_tenths_where_theory_says(real_images, shape, subset_px):
    settings = CorrelationSettings(subset_px=subset_px, step_px=4, shape=shape)
    found = star_resolution(read_star(real_images / "star2"), settings)
    assert found.measured_px == pytest.approx(found.theory_px, rel=0.05)


def test_a_strained_pattern_is_measured_without_bias():
    speckle = Speckle(seed=6, shape=(256, 256))
    settings = CorrelationSettings(subset_px=21, step_px=8, shape="quadratic")
    field = Correlator(speckle.draw().astype(np.float32), settings=settings).correlate(
        speckle.draw(gentle_strain()).astype(np.float32)
    )
    x, y = np.meshgrid(field.x_px.astype(float), field.y_px.astype(float))
    u, v = truth(gentle_strain(), x, y)
    error = np.stack([field.u_px - u, field.v_px - v])[:, field.converged]
    assert field.converged.sum() >= 0.99 * field.in_view
    assert np.abs(error.mean(axis=1)).max() < 1e-4
    assert error.std(axis=1).max() < 1e-3
