"""In the errors of weighted sums of displacements, the interpolation bias counts only once."""

from dataclasses import replace

import numpy as np
import pytest

from dic.out_of_plane.correction import points_of
from dic.strain.fit import gradient_weights
from simulators.scene.optics import PinholeCamera
from tests.dic.out_of_plane.exact_views import State, View

VIEW = View(PinholeCamera(800, 800), seed=2)
SMOOTH_MPX = 0.4  # what benchmarks.order measures on rendered images


def smooth_std(bias_mpx):
    """Return the standard deviation of exx from smooth errors, if all points have the bias `bias_mpx`."""
    calibration = VIEW.calibration()
    (seen,) = VIEW.measurements([State()], calibration)
    points = points_of(seen, calibration)
    bias = 1e-3 * bias_mpx * calibration.mm_per_px * np.broadcast_to(np.eye(2), (*points.use.shape, 2, 2))
    noise = replace(points.displacement.noise, bias=bias)
    biased = replace(points, displacement=replace(points.displacement, noise=noise))
    weights = gradient_weights(points.before_mm)
    return float(np.sqrt(biased.smooth_covariance(weights)[0, 0]))


@pytest.mark.parametrize("bias_mpx", [0.1, 0.24, 0.3])
def test_smooth_errors_and_predicted_bias_have_the_variance_of_the_errors_together(bias_mpx):
    share = np.sqrt(SMOOTH_MPX**2 - bias_mpx**2) / SMOOTH_MPX
    assert smooth_std(bias_mpx) == pytest.approx(share * smooth_std(0.0), rel=1e-4)


def test_a_bias_beyond_all_measured_errors_leaves_no_other_smooth_error():
    assert smooth_std(0.0) > 0.0
    assert smooth_std(1.0) == 0.0


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_a_plane_without_points_is_not_determined(degree):
    (seen,) = VIEW.measurements([State()], VIEW.calibration())
    points = points_of(seen, VIEW.calibration())
    assert points.determine(degree)
    assert not replace(points, use=np.zeros_like(points.use)).determine(degree)


@pytest.mark.parametrize("model", ["bicubic", "pinhole"])
def test_many_points_have_the_covariances_of_all_points_together(model, monkeypatch):
    """Many points are computed in blocks, which need less memory."""
    calibration = replace(VIEW.calibration(), model=model)
    (seen,) = VIEW.measurements([State()], calibration)
    points = points_of(seen, calibration)
    assert not points.use.all()
    weights = np.random.default_rng(4).normal(size=(len(points.before_mm), 2, 24))
    whole = points.noise_covariance(weights), *points.calibration_factors(weights)
    monkeypatch.setattr("dic.out_of_plane.uncertainty.MANY_POINTS", 0)
    monkeypatch.setattr("dic.out_of_plane.uncertainty._SOME_POINTS", 97)
    monkeypatch.setattr("dic.strain.mean_in_blocks._BLOCK_POINTS", 7 * 6 * points.use.shape[1])
    blocks = points.noise_covariance(weights), *points.calibration_factors(weights)
    for mine, other in zip(blocks, whole, strict=True):
        assert np.abs(other).max() > 0
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
