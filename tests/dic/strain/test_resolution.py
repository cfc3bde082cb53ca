"""The stated loss of a varying strain is compared with plain sums and with the star images."""

import math

import numpy as np
import pytest

from benchmarks.accuracy import read_star
from benchmarks.theory import transfer
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.strain.measurement import measure
from dic.strain.resolution import Filters, amplitude_kept, amplitude_lost, strain_resolution_px
from dic.strain.settings import StrainSettings


@pytest.mark.parametrize("source", ["fit", "quadratic-fit", "shape"])
@pytest.mark.parametrize("shape", ["affine", "quadratic"])
@pytest.mark.parametrize("period_px", [60.0, 137.0])
def test_a_wave_is_kept_as_plain_fits_keep_it(period_px, shape, source):
    subset_px, step_px, window = 21, 6, 5
    filters = Filters(CorrelationSettings(subset_px, step_px, shape), StrainSettings("small", window, source))
    k = 2 * math.pi / period_px
    if source == "shape":
        offset = np.arange(subset_px) - subset_px // 2
        slope = np.polyfit(offset, np.sin(k * offset), {"affine": 1, "quadratic": 2}[shape])[-2]
    else:
        offset = step_px * (np.arange(window) - window // 2)
        slope = transfer(subset_px, shape, period_px) * np.polyfit(offset, np.sin(k * offset), 1)[0]
    assert filters.along(np.array([k]))[0] == pytest.approx(slope / k, abs=1e-12)


@pytest.mark.parametrize(("along_x", "per_px"), [(True, (0.06, 0.03)), (False, (0.02, 0.05))])
def test_an_oblique_wave_is_told_from_what_is_left_of_it(along_x, per_px):
    """The displacement is averaged over subsets and fitted over windows in plain loops."""
    subset_px, step_px, window = 15, 5, 5
    filters = Filters(CorrelationSettings(subset_px, step_px, "affine"), StrainSettings("small", window))
    kx, ky = per_px
    inner = np.arange(subset_px) - subset_px // 2
    average = np.cos(kx * inner).mean() * np.cos(ky * inner).mean()
    y, x = step_px * np.mgrid[:60, :70].astype(float)
    displacement = average * np.sin(kx * x + ky * y)
    reach = window // 2
    strain = np.full(x.shape, np.nan)
    offset = step_px * (np.arange(window) - reach)
    for row in range(reach, 60 - reach):
        for column in range(reach, 70 - reach):
            part = displacement[row - reach : row + reach + 1, column - reach : column + reach + 1]
            line = part.mean(axis=0 if along_x else 1)
            strain[row, column] = (line @ offset) / (offset @ offset)
    k = kx if along_x else ky
    true = k * np.cos(kx * x + ky * y)
    known = np.isfinite(strain)
    left = (strain[known] @ true[known]) / (true[known] @ true[known])
    kept = amplitude_kept(strain, np.full(x.shape, 1e-9), filters, along_x=along_x)
    np.testing.assert_allclose(kept[20:-20, 20:-20], left, atol=0.01)
    assert amplitude_lost(strain, kept) == pytest.approx(1 - left, abs=0.01)


def test_nothing_is_said_of_noise_and_nothing_is_lost_of_uniform_strain(speckle):
    pattern = speckle(seed=71, shape=(260, 280))
    region = np.ones(pattern.shape, bool)

    def strained(strain):
        noisy = pattern.draw(noise_seed=1) + np.random.default_rng(1).normal(0, 3, pattern.shape)
        moved = pattern.draw(lambda x, y: (x / (1 + strain), y)) + np.random.default_rng(2).normal(
            0, 3, pattern.shape
        )
        correlator = Correlator(noisy.astype(np.float32), region, CorrelationSettings(21, 7))
        return measure(correlator.correlate(moved.astype(np.float32)), strain=StrainSettings("small"))

    still, pulled = strained(0.0), strained(0.02)
    known = np.isfinite(still.strain.exx)
    assert np.isfinite(still.amplitude_kept["exx"][known]).mean() < 0.1
    assert abs(pulled.amplitude_lost["exx"]) < 0.005
    assert still.summary()["strain"]["resolution_px"] == pytest.approx(still.resolution_px, abs=0.05)


def check_star(images, subset_px, step_px, shape, window):
    """Check stated losses from 5 to 40 % of a wave's amplitude, on the star images."""
    settings, strain = CorrelationSettings(subset_px, step_px, shape), StrainSettings("small", window)
    reference, deformed = images
    field = Correlator(reference, np.ones(reference.shape, bool), settings).correlate(deformed)
    measured = measure(field, strain=strain)
    period = 10.0 + 290.0 * field.x_px / 4000.0
    waves = (field.y_px[:, None] - 250.0) / period
    true = -0.5 * 2 * np.pi / period * np.sin(2 * np.pi * waves)
    eyy, kept = measured.strain.eyy, measured.amplitude_kept["eyy"]
    # Farther from the middle the waves run obliquely, with a shorter period.
    weight = np.where(np.isfinite(kept) & (np.abs(waves) <= 1), true * true, 0.0)
    with np.errstate(invalid="ignore"):
        left = np.nansum(weight * eyy / true, axis=0) / weight.sum(axis=0)
        predicted = np.nansum(weight * kept, axis=0) / weight.sum(axis=0)
    some = (left > 0.6) & (left < 0.95) & (period < 280)
    assert some.sum() > 20
    np.testing.assert_allclose(predicted[some], left[some], atol=0.03)
    assert abs((predicted - left)[some].mean()) < 0.01
    # the static figure: the period of which nine tenths are kept
    nine_tenths = np.interp(0.9, left[some], period[some]) if shape == "quadratic" else None
    if nine_tenths is not None:
        assert strain_resolution_px(settings, strain) == pytest.approx(nine_tenths, rel=0.06)


def test_the_loss_of_the_star_s_strain_is_told_from_the_measured_strain(real_images):
    check_star(read_star(real_images / "star2"), 31, 10, "quadratic", 3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("subset_px", "step_px", "shape", "window"),
    [
        (31, 10, "affine", 5),
        (21, 5, "affine", 5),
        (15, 5, "affine", 7),
        (21, 7, "affine", 3),
        (21, 7, "quadratic", 5),
        (31, 5, "quadratic", 9),
        (41, 10, "quadratic", 3),
        (25, 8, "quadratic", 7),
    ],
)
def test_the_loss_is_told_for_eight_settings(real_images, subset_px, step_px, shape, window):
    check_star(read_star(real_images / "star2"), subset_px, step_px, shape, window)


def test_a_field_in_bands_of_rows_has_the_same_amplitudes(monkeypatch):
    rng, (y, x) = np.random.default_rng(8), np.mgrid[:90, :40]
    strain = 1e-3 * np.sin(x / 3.0) * np.cos(y / 4.0) + rng.normal(0, 2e-5, x.shape)
    strain[30:37, 10:20] = np.nan
    std, filters = np.full(x.shape, 2e-5), Filters(CorrelationSettings(21, 10), StrainSettings())
    whole = amplitude_kept(strain, std, filters, along_x=True)
    monkeypatch.setattr("dic.strain.resolution._POINTS", 1)
    np.testing.assert_array_equal(amplitude_kept(strain, std, filters, along_x=True), whole)
    assert np.isfinite(whole).mean() > 0.5
