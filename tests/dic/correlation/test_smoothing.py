"""Tests of smoothing: when it is chosen, how much bias it leaves, and how it correlates the noise."""

import numpy as np
import pytest

from benchmarks.speckle import Speckle, shift
from dic import CorrelationSettings, Correlator, measure
from dic.correlation import Series
from dic.correlation.smoothing import LARGEST_BIAS_PX, Smoothing
from dic.errors import CorrelationError
from tests.dic.correlation.sharp_patterns import discs


def images_of(draw, *shifts):
    return [np.asarray(draw(*moved), np.float32) for moved in shifts]


@pytest.fixture(scope="module")
def good():
    speckle = Speckle(seed=5, shape=(200, 200))
    return images_of(lambda u, v: speckle.draw(shift(u, v)), (0, 0), (0.25, -0.25))


@pytest.fixture(scope="module")
def sharp():
    return images_of(discs(3, 0.3), (0, 0), (0.25, 0.25))


def test_a_pattern_without_bias_is_not_smoothed_and_keeps_its_results(good):
    auto, none = (
        Correlator(good[0], settings=CorrelationSettings(21, 12, smoothing_px=smoothing)).correlate(good[1])
        for smoothing in ("auto", 0)
    )
    assert auto.smoothing_px == 0.0
    np.testing.assert_array_equal(auto.warps, none.warps)
    np.testing.assert_array_equal(auto.std, none.std)


def test_a_sharp_pattern_is_smoothed_until_its_bias_is_below_the_limit(sharp):
    correlator = Correlator(sharp[0], settings=CorrelationSettings(21, 9), clip=False)
    field = correlator.correlate(sharp[1])
    assert field.smoothing_px == correlator.smoothing.width_px > 0.0
    assert max(map(abs, field.greatest_bias_px)) <= LARGEST_BIAS_PX
    for measured in (field.u_px, field.v_px):
        assert abs(measured[field.converged].mean() - 0.25) < LARGEST_BIAS_PX


def test_smoothing_lessens_the_bias_of_fine_blobs_as_predicted():
    speckle = Speckle(seed=3, shape=(260, 260), sigma_px=(0.8, 1.1), density=0.12)
    still, moved = images_of(lambda u, v: speckle.draw(shift(u, v)), (0, 0), (0.25, 0.25))
    for smoothing_px in (0.0, 0.4):
        settings = CorrelationSettings(21, 9, shape="affine", order=3, smoothing_px=smoothing_px)
        field = Correlator(still, np.ones(still.shape, bool), settings, clip=False).correlate(moved)
        happened = float((field.u_px[field.converged] - 0.25).mean())
        assert field.greatest_bias_px[0] == pytest.approx(happened, rel=0.2)


@pytest.mark.parametrize(
    ("shape", "smoothing_px"),
    [
        *(("affine", 0.5), ("quadratic", 1.0)),
        *(pytest.param(*case, marks=pytest.mark.extended) for case in (("affine", 1.0), ("quadratic", 0.5))),
    ],
)
def test_predicted_std_of_smoothed_images_is_that_of_repeated_images(good, shape, smoothing_px):
    settings = CorrelationSettings(21, 24, shape=shape, smoothing_px=smoothing_px)
    region = np.ones(good[0].shape, bool)
    rng = np.random.default_rng(7)
    warps, predicted = [], []
    for _ in range(40):
        still, moved = (image + rng.normal(0, 4, image.shape).astype(np.float32) for image in good)
        field = Correlator(still, region, settings).correlate(moved)
        warps.append(field.warps[..., :6])
        predicted.append(field.std)
    observed = np.sqrt(np.var(warps, axis=0, ddof=1).mean(axis=(0, 1)))
    stated = np.sqrt(np.mean(np.square(predicted), axis=(0, 1, 2)))
    np.testing.assert_allclose(stated, observed, rtol=0.10)


@pytest.mark.parametrize("seed", range(4))
def test_where_noise_hides_the_pattern_the_standard_deviation_is_still_known(seed):
    rng = np.random.default_rng(seed)
    white = rng.uniform(0.0, 255.0, (80, 80)).astype(np.float32)
    again = white + rng.normal(0.0, 2.0, white.shape).astype(np.float32)
    settings = CorrelationSettings(21, 12, smoothing_px=0.6)
    everywhere = np.ones(white.shape, bool)
    field = Correlator(white, everywhere, settings, clip=False).correlate(again)
    assert field.converged.all()
    assert np.isfinite(field.std).all()
    assert (field.std > 0.0).all()


def test_the_filter_keeps_a_uniform_image_and_damps_white_noise_as_stated():
    smoothing = Smoothing(0.8)
    np.testing.assert_allclose(smoothing.apply(np.full((40, 40), 90, np.float32)), 90, rtol=1e-6)
    noise = np.random.default_rng(0).normal(0, 1, (600, 600)).astype(np.float32)
    assert smoothing.apply(noise).std() == pytest.approx(smoothing.noise_factor, rel=0.01)


def test_later_references_of_a_series_are_smoothed_like_the_first():
    draw = discs(3, 0.3, size_px=160)
    still, *moved = images_of(draw, (0, 0), (0.3, 0.1), (0.55, 0.2))
    series = Series(still, settings=CorrelationSettings(21, 12), incremental="always")
    fields = [series.correlate(image) for image in moved]
    assert fields[1].updates == 1
    assert fields[0].smoothing_px == fields[1].smoothing_px > 0.0
    assert series.settings.smoothing_px == "auto"


def test_the_standard_deviation_contains_the_bias(sharp):
    """The bias of all points is the same here: they are all displaced by a quarter of a pixel."""
    settings = CorrelationSettings(21, 9, smoothing_px=0)
    field = Correlator(sharp[0], settings=settings).correlate(sharp[1])
    found = field.converged
    np.testing.assert_allclose(field.bias_px[found][:, 0], field.greatest_bias_px[0], rtol=0.02)
    noise, bias = field.noise_std_px[found], field.bias_px[found]
    np.testing.assert_allclose(field.std_u_px[found] ** 2, noise[:, 0] ** 2 + bias[:, 0] ** 2)
    np.testing.assert_allclose(field.std_v_px[found] ** 2, noise[:, 1] ** 2 + bias[:, 1] ** 2)
    # A bias that is the same everywhere is no strain.
    part = measure(field).summary()["interpolation"]
    assert part["exx_std"] < 5e-6


@pytest.mark.parametrize("wrong", ["much", -0.1, 6.0, True, None])
def test_a_senseless_smoothing_is_refused(wrong):
    with pytest.raises(CorrelationError, match="smoothing: expected auto, or between 0 and 5 px"):
        CorrelationSettings(smoothing_px=wrong)


def test_the_mean_displacement_of_a_real_series_is_the_same_with_and_without_smoothing(real_images):
    """The means differ by less than the standard deviation that a point states."""
    folder = real_images / "ohtcfrp"
    fields = []
    for smoothing_px in ("auto", 0):
        settings = CorrelationSettings(smoothing_px=smoothing_px)
        correlator = Correlator(folder / "ohtcfrp_00.png", folder / "roi.png", settings)
        fields.append([correlator.correlate(folder / f"ohtcfrp_{k:02d}.png") for k in (1, 4, 7, 11)])
    for smooth, raw in zip(*fields, strict=True):
        assert smooth.smoothing_px > 0.0
        both = smooth.converged & raw.converged
        assert both.sum() > 0.95 * smooth.in_view
        for one, other, std in ((smooth.u_px, raw.u_px, raw.std_u_px), (smooth.v_px, raw.v_px, raw.std_v_px)):
            assert abs((one - other)[both].mean()) < np.median(std[both])
