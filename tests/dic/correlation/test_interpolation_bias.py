"""The predicted interpolation bias is compared with the measured bias of exactly shifted patterns."""

import numpy as np
import pytest

from benchmarks.speckle import Speckle, shift
from dic import CorrelationSettings, Correlator, assess_quality
from dic.correlation.interpolation_bias import bias_at, fitted_slope, slope_bias_at, strain_error
from dic.correlation.pattern_spectrum import pattern_spectrum
from dic.correlation.transfer import interpolation_transfer, slope_transfer
from tests.dic.correlation.sharp_patterns import discs, real_pattern

SHIFT_PX = 0.25
"""The sub-pixel displacement, px, at which the interpolation bias is greatest."""

TRUE_SHIFTS = {
    "blobs of 1.3 to 2.2 px": lambda: _blobs((1.3, 2.2)),
    "blobs of 0.8 to 1.1 px": lambda: _blobs((0.8, 1.1)),
    "blobs of 0.6 to 0.8 px": lambda: _blobs((0.6, 0.8)),
    "small sharp discs": lambda: discs(3, 0.4),
    "sharp discs": lambda: discs(5, 0.5),
    "soft discs": lambda: discs(4, 0.7),
}

FIRST = "blobs of 0.8 to 1.1 px", "sharp discs"
"""The patterns of the first part of the tests: a round one and one with edges."""

REAL = {
    "plate with a hole": ("ohtcfrp/ohtcfrp_00.png", 2, np.s_[:, :]),
    "before a rotation": ("rotation170/rotation_000.tif", 2, np.s_[:, :]),
    "after a rotation": ("rotation170/rotation_170.tif", 2, np.s_[100:420, 100:420]),
    "necking specimen": ("tension/img_0.tif", 3, np.s_[60:520, 300:1200]),
}


def _blobs(sigma_px):
    density = 0.035 * (1.75 / np.mean(sigma_px)) ** 2
    speckle = Speckle(seed=3, shape=(260, 260), sigma_px=sigma_px, density=density)
    return lambda u, v: speckle.draw(shift(u, v)).astype(np.float32)


def check_prediction(draw):
    """Check that predicted and measured bias differ at most by a factor of 1.5.

    The prediction uses one noisy image.
    """
    still = draw(0, 0)
    seen = still + np.random.default_rng(1).normal(0, 1, still.shape).astype(np.float32)
    settings = CorrelationSettings(subset_px=21, step_px=9, smoothing_px=0)
    judged = assess_quality(seen, settings=settings)
    field = Correlator(still, judged.region, settings, clip=False).correlate(draw(SHIFT_PX, SHIFT_PX))
    found = field.converged
    assert found.sum() > 200
    for measured, predicted in zip((field.u_px, field.v_px), judged.interpolation.bias_px, strict=True):
        happened = float((measured[found] - SHIFT_PX).mean())
        assert happened / 1.5 < predicted < 1.5 * happened


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in FIRST else pytest.mark.extended) for name in TRUE_SHIFTS],
)
def test_the_predicted_bias_of_a_drawn_pattern_happens(name):
    check_prediction(TRUE_SHIFTS[name]())


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name.endswith("rotation") else pytest.mark.extended) for name in REAL],
)
def test_the_predicted_bias_of_a_real_pattern_happens(real_images, name):
    path, factor, crop = REAL[name]
    check_prediction(real_pattern(real_images / path, factor, 0.4, crop))


@pytest.mark.extended
def test_the_predicted_bias_of_the_plate_with_a_hole_is_seen_in_its_series(real_images):
    """Strong smoothing of both images removes the bias, so the difference to it shows the bias itself.

    The plate moves by up to 12 px along y and 1.4 px along x; its motion is the same with and without
    smoothing, because the subset is the same. So only the bias depends on the sub-pixel displacement.
    """
    folder = real_images / "ohtcfrp"
    fields = {}
    for smoothing_px in (0, 1.5):
        settings = CorrelationSettings(smoothing_px=smoothing_px)
        correlator = Correlator(folder / "ohtcfrp_00.png", folder / "roi.png", settings)
        fields[smoothing_px] = [correlator.correlate(folder / f"ohtcfrp_{k:02d}.png") for k in (6, 8, 10, 11)]
    judged = assess_quality(folder / "ohtcfrp_00.png", folder / "roi.png")
    for axis, predicted_px in enumerate(judged.interpolation.bias_px):
        waves, differences = [], []
        for raw, smooth in zip(*fields.values(), strict=True):
            both = raw.converged & smooth.converged
            true = (smooth.u_px, smooth.v_px)[axis][both]
            waves.append(np.stack([np.ones_like(true), np.sin(2 * np.pi * true), np.cos(2 * np.pi * true)]))
            differences.append((raw.u_px, raw.v_px)[axis][both] - true)
        seen = np.linalg.lstsq(np.hstack(waves).T, np.concatenate(differences), rcond=None)[0][1]
        assert seen / 1.5 < predicted_px < 1.5 * seen


@pytest.mark.parametrize("order", [3, 5])
def test_the_transfer_of_the_interpolation_is_that_of_its_impulse(order):
    """The cardinal spline passes through one pixel of value 1 and zeros; its integral transform is known."""
    from scipy.interpolate import make_interp_spline

    at = np.arange(-40, 41)
    spline = make_interp_spline(at, (at == 0).astype(float), k=order)
    fine = np.linspace(-20, 20, 40 * 64 + 1)
    frequency = np.array([0.3, 1.1, 2.5, 3.0, 3.5, 5.0])
    expected = [np.trapezoid(spline(fine) * np.cos(w * fine), fine) for w in frequency]
    np.testing.assert_allclose(interpolation_transfer(frequency, order), expected, atol=2e-4)
    slope = spline.derivative()(at)
    expected = [-(slope * np.sin(w * at)).sum() for w in frequency[:4]]
    np.testing.assert_allclose(slope_transfer(frequency[:4], order), expected, rtol=1e-3)


def test_the_power_of_white_noise_is_its_variance_at_all_frequencies():
    noise = np.random.default_rng(0).normal(0, 3, (400, 400)).astype(np.float32)
    spectrum = pattern_spectrum(noise, np.ones(noise.shape, bool))
    assert spectrum.power.mean() == pytest.approx(9, rel=0.02)
    assert spectrum.corner == pytest.approx(9, rel=0.05)


def test_a_wave_has_its_power_at_its_frequency():
    x = np.arange(256)
    wave = np.tile(np.cos(2 * np.pi * 16 / 64 * x), (256, 1)).astype(np.float32)
    spectrum = pattern_spectrum(wave, np.ones(wave.shape, bool))
    assert np.unravel_index(spectrum.power.argmax(), spectrum.power.shape) == (0, 16)
    share = spectrum.power * spectrum.counts
    assert share.sum() / 64**2 == pytest.approx(0.5, rel=1e-3)


def test_a_narrow_region_is_judged_by_smaller_tiles_and_a_tiny_one_not_at_all():
    noise = np.random.default_rng(0).normal(0, 3, (200, 200)).astype(np.float32)
    region = np.zeros(noise.shape, bool)
    region[:, 64:104] = True
    assert len(pattern_spectrum(noise, region).power) == 17
    region[:, 72:] = False
    assert pattern_spectrum(noise, region) is None


def test_a_fitted_slope_is_that_of_least_squares():
    at = np.linspace(-20, 20, 4001)
    for frequency in (0.01, 0.1, -0.3):
        expected = np.polyfit(at, np.sin(frequency * at), 1)[0]
        assert fitted_slope(frequency, 20.0) == pytest.approx(expected, rel=1e-3)


def test_the_bias_of_a_strained_subset_is_the_mean_over_its_pixels():
    u, gradient, subset = 0.2, np.array([0.012, -0.007]), 31
    y, x = np.mgrid[-15:16, -15:16]
    local = 0.004 * np.sin(2 * np.pi * (u + gradient[0] * x + gradient[1] * y))
    assert bias_at(np.array(u), gradient, subset, 0.004) == pytest.approx(local.mean(), rel=2e-3)
    design = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
    slopes = np.linalg.lstsq(design, local.ravel(), rcond=None)[0][1:]
    np.testing.assert_allclose(slope_bias_at(np.array(u), gradient, subset, 0.004), slopes, rtol=0.01)


def test_the_strain_error_is_the_greatest_slope_of_the_bias_over_the_gauge():
    at = np.linspace(-20, 20, 401)
    worst = max(
        abs(np.polyfit(at, 0.005 * np.sinc(strain * 31) * np.sin(2 * np.pi * strain * at), 1)[0])
        for strain in np.linspace(0, 0.01, 201)
    )
    assert strain_error(0.005, 71, 31, 0.01) == pytest.approx(worst, rel=0.01)
