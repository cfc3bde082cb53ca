"""Stated deviations that contain the interpolation bias are compared with errors on drawn patterns."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.speckle import Speckle
from dic import CorrelationSettings, Correlator, StrainSettings, measure
from dic.correlation.chaining import chain
from dic.strain.displacement import raw_displacement
from dic.strain.strain import strain_field

STRAIN = 0.008
"""Displacement gradient along x of the drawn motion: u = 0.008 X at the reference position X."""


@pytest.fixture(scope="module")
def strained():
    """The field of a strained pattern of fine blobs, without noise; the cubic spline has a bias of 10 mpx."""
    speckle = Speckle(seed=6, shape=(260, 300), sigma_px=(0.6, 0.8), density=0.22)
    still = speckle.draw().astype(np.float32)
    # The material that is now at x was at x / (1 + strain).
    moved = speckle.draw(lambda x, y: (x * STRAIN / (1 + STRAIN), np.zeros_like(x))).astype(np.float32)
    settings = CorrelationSettings(21, 7, shape="affine", order=3, smoothing_px=0)
    return Correlator(still, np.ones(still.shape, bool), settings, clip=False).correlate(moved)


def error_of(field):
    x = np.broadcast_to(field.x_px, field.u_px.shape)
    return field.u_px - STRAIN * x


def test_the_bias_of_each_point_follows_its_sub_pixel_displacement(strained):
    found = strained.converged
    error, bias = error_of(strained)[found], strained.bias_px[found][:, 0]
    assert np.corrcoef(error, bias)[0, 1] > 0.85
    # The prediction neglects aliased waves, which reduce the bias of this pattern by a tenth.
    assert 0.75 < (error @ bias) / (bias @ bias) < 1.1


@pytest.mark.parametrize("source", ["fit", "shape"])
def test_the_bias_of_local_strain_is_in_its_standard_deviation(strained, source):
    displacement = raw_displacement(strained)
    part = replace(displacement, noise=displacement.noise.of_bias())
    chosen = StrainSettings("small", source=source)
    if source == "shape":
        gradient_bias = strained.gradient_bias[..., 0]
        stated = np.sqrt(np.nanmean(gradient_bias[strained.converged] ** 2))
    else:
        stated = np.sqrt(np.nanmean(strain_field(part, chosen).exx_std ** 2))
    local = strain_field(displacement, chosen)
    known = np.isfinite(local.exx)
    bias = local.exx[known] - STRAIN
    # Only the part that repeats along x is the bias; the rest differs from subset to subset.
    columns = np.broadcast_to(strained.x_px, known.shape)[known]
    means = np.array([bias[columns == x].mean() for x in np.unique(columns)])
    assert stated == pytest.approx(np.sqrt(np.mean(means**2)), rel=0.25)
    assert (local.exx_std[known] > 0).all()
    scatter = np.sqrt(np.mean(bias**2))
    assert np.sqrt(np.mean(local.exx_std[known] ** 2)) > 0.9 * scatter


def test_the_mean_strain_names_the_part_of_the_bias(strained):
    found = measure(strained)
    part = found.summary()["interpolation"]
    assert part["smoothing_px"] == 0.0
    assert part["bias_u_px"] == strained.greatest_bias_px[0]
    # By the first order: the slope of the line that fits the bias of all points.
    x = np.broadcast_to(strained.x_px, strained.u_px.shape)[strained.converged]
    y = np.broadcast_to(strained.y_px[:, None], strained.u_px.shape)[strained.converged]
    design = np.stack([x, y, np.ones(x.size)], axis=1)
    slope = np.linalg.lstsq(design, strained.bias_px[strained.converged][:, 0], rcond=None)[0][0]
    assert part["exx_std"] == pytest.approx(abs(slope), rel=0.02)
    without = measure(replace(strained, greatest_bias_px=(0.0, 0.0)))
    noise, whole = without.raw_mean.exx_std, found.raw_mean.exx_std
    assert whole == pytest.approx(np.hypot(noise, part["exx_std"]), rel=1e-3)


def test_a_chain_of_fields_adds_the_biases(strained):
    again = chain(strained, strained)
    both = again.converged
    assert both.sum() > 200
    place = strained.bias_px[both]
    # The second field starts where the first ends, up to 2 px away: nearly the same point of the grid.
    assert np.median(np.abs(again.bias_px[both] - 2 * place)) < 0.2 * np.abs(place).max()
    np.testing.assert_allclose(
        again.std_u_px[both] ** 2, again.noise_std_px[both][:, 0] ** 2 + again.bias_px[both][:, 0] ** 2
    )
