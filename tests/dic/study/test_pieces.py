"""Tests of the parts of a study: wave, sweep, noise and bias, pattern without noise, complete windows."""

from dataclasses import replace

import numpy as np
import pytest

import dic
from dic.strain.displacement import raw_displacement
from dic.strain.strain import strain_field
from dic.study.parts import PART_PX, chosen_parts
from dic.study.pattern import Pattern
from dic.study.windows import noise_factor_per_px, window_strain


@pytest.mark.parametrize("across_px", [np.inf, 130.0])
def test_wave_is_inverted_exactly_and_its_gradient_is_its_derivative(across_px):
    wave, phases, step = dic.study.Wave(80.0, 0.15, across_px), (1.0, 0.3), 1e-4
    x, y = np.meshgrid(np.linspace(0.0, 300.0, 201), np.linspace(0.0, 200.0, 101))
    from_x, from_y = wave.origin(x, y, phases)
    u, v = wave.displacement_px(from_x, from_y, phases)
    np.testing.assert_allclose([from_x + u, from_y + v], [x, y], atol=1e-9)
    gradient = wave.gradient(x, y, phases)
    for j, (right, down) in enumerate(((step, 0.0), (0.0, step))):
        ahead, behind = (wave.displacement_px(x + k * right, y + k * down, phases) for k in (1, -1))
        np.testing.assert_allclose(
            gradient[..., j], np.moveaxis(ahead - behind, 0, -1) / (2 * step), atol=1e-8
        )
    assert wave.is_plane == (across_px == np.inf)
    greatest = 0.15 * (np.cos(0.3) if wave.is_plane else 1.0)
    assert np.abs(gradient[..., 0, 0]).max() == pytest.approx(greatest, rel=1e-2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"period_px": 3.0}, "period of the assumed strain: expected 10 to 100000 px, got 3.0; give about"),
        ({"period_px": float("nan")}, "expected 10 to 100000 px, got nan"),
        ({"across_px": 0.0}, "across its direction: expected at least 10 px, or infinite, got 0.0"),
        ({"strain_amplitude": 0.0}, "expected above 0 and at most 0.2, got 0.0; give 0.005"),
    ],
)
def test_wave_refuses_what_no_study_can_assume(values, words):
    with pytest.raises(dic.errors.CorrelationError, match=words):
        dic.study.Wave(**values)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"subsets_px": (20,)}, "subset: expected an odd number, at least 7 px, got 20"),
        ({"windows_points": (4,)}, "strain window: expected an odd number of points, at least 3, got 4"),
        ({"shapes": ("cubic",)}, "shape function: expected affine or quadratic, got cubic"),
        ({"steps_px": ()}, "steps: expected one value or several different ones"),
        ({"subsets_px": (21, 21)}, "subsets: expected one value or several different ones"),
        ({"parts": 0}, "parts: expected a whole number from 1 to 64, got 0"),
        ({"steps_px": tuple(range(1, 60)), "subsets_px": tuple(range(7, 101, 2))}, "at most 2000, got"),
    ],
)
def test_sweep_refuses_bad_and_too_many_values(values, words):
    with pytest.raises(dic.errors.CorrelationError, match=words):
        dic.study.Sweep(**values)


def test_points_of_wider_steps_are_taken_from_those_of_the_step_that_divides_them():
    sweep = dic.study.Sweep(steps_px=(4, 6, 8, 12))
    assert [sweep.measured_with(step) for step in sweep.steps_px] == [4, 6, 4, 4]
    assert sweep.measured_steps_px == (4, 6)


def test_parts_lie_inside_the_region_apart_from_one_another():
    region = np.zeros((1500, 2200), bool)
    region[100:1400, 700:2100] = True
    parts = chosen_parts(region, 4)
    covered = np.zeros(region.shape, int)
    for part in parts:
        assert (part.height, part.width) == (PART_PX, PART_PX)
        covered[part.pixels] += 1
    assert len(parts) == 4
    assert np.count_nonzero(covered > 1) < 0.1 * PART_PX**2
    assert region[covered > 0].all()


def test_small_region_is_one_part():
    region = np.zeros((500, 600), bool)
    region[50:450, 100:580] = True
    (part,) = chosen_parts(region, 4)
    assert (part.top, part.left, part.height, part.width) == (50, 100, 400, 480)


def test_narrow_region_has_as_many_parts_as_it_holds():
    region = np.zeros((200, 4000), bool)
    region[20:180] = True
    parts = chosen_parts(region, 16)
    assert {(part.top, part.height) for part in parts} == {(20, 160)}
    # at most half of a part may belong to others
    assert 4000 // PART_PX <= len(parts) <= 16


def test_band_limited_image_is_drawn_exactly_at_any_place():
    size, wave = 64, 2 * np.pi / 7.3
    # a cosine that reflection at the edges continues
    wave = np.pi * round(wave * size / np.pi) / size
    at = np.arange(size)
    grey = 100 + 30 * np.cos(wave * (at + 0.5))[:, None] * np.cos(2 * wave * (at + 0.5))
    y, x = np.linspace(3.0, 60.0, 45), np.linspace(1.0, 62.0, 31)
    drawn = Pattern.of(grey.astype(np.float32), 0.0).draw(y, x)
    true = 100 + 30 * np.cos(wave * (y + 0.5))[:, None] * np.cos(2 * wave * (x + 0.5))
    np.testing.assert_allclose(drawn, true, atol=1e-3)
    everywhere = Pattern.of(grey.astype(np.float32), 0.0).draw_at(*np.meshgrid(y, x, indexing="ij"))
    np.testing.assert_allclose(everywhere, true, atol=1e-3)


def test_noise_is_removed_and_the_contrast_of_the_pattern_stays(speckle):
    pattern, noise = speckle(seed=4, shape=(300, 320)), 8.0
    clean = pattern.draw()
    noisy = (clean + np.random.default_rng(2).normal(0, noise, clean.shape)).astype(np.float32)
    y, x = (np.arange(n, dtype=float) for n in clean.shape)
    found = Pattern.of(noisy, noise).draw(y, x)
    assert found.std() == pytest.approx(clean.std(), rel=0.01)
    assert (found - clean).std() < 0.6 * noise
    slopes = [np.abs(np.gradient(each, axis=1)).std() for each in (found, clean, noisy)]
    assert slopes[0] == pytest.approx(slopes[1], rel=0.03)
    # Waves that only noise can have are gone.
    spectra = [np.abs(np.fft.fft2(each))[130:170, 140:180].std() for each in (found, noisy)]
    assert spectra[0] < 0.3 * spectra[1]


def test_strain_of_complete_windows_is_that_of_the_measurement(speckle):
    pattern = speckle(seed=6, shape=(160, 180))
    deformed = pattern.draw(lambda x, y: (x - 0.01 * x - 0.004 * y, y + 0.006 * x))
    whole = np.ones(pattern.shape, bool)
    field = dic.Correlator(pattern.draw(), whole, dic.CorrelationSettings(21, 8)).correlate(deformed)
    for window in (3, 5):
        settings = dic.StrainSettings(window_points=window)
        usual = strain_field(raw_displacement(field), settings)
        own = window_strain(field.u_px, field.v_px, 8, settings)
        inner = np.s_[window // 2 : -(window // 2), window // 2 : -(window // 2)]
        for ours, theirs in zip(own, (usual.exx, usual.eyy), strict=True):
            np.testing.assert_allclose(ours[inner], theirs[inner], atol=1e-10)
            assert np.isnan(ours[0]).all()


@pytest.mark.parametrize("window", [pytest.param(3, marks=pytest.mark.extended), 5, 9])
def test_noise_of_strain_is_that_of_a_slope_if_subsets_do_not_overlap(window):
    correlation = dic.CorrelationSettings(subset_px=15, step_px=20)
    offset = 20.0 * (np.arange(window) - window // 2)
    expected = 1.0 / np.sqrt(window * (offset @ offset))
    factor = noise_factor_per_px(correlation, dic.StrainSettings(window_points=window))
    assert factor == pytest.approx(expected, rel=1e-6)
    closer = replace(correlation, step_px=10)
    assert noise_factor_per_px(closer, dic.StrainSettings(window_points=window)) > factor


def test_a_subset_that_fills_the_vectors_is_recommended_if_its_error_is_nearly_the_least():
    """41 px takes three vectors of 16 columns; of 39 px, the last one has 8."""
    errors = {21: 1.3, 31: 1.05, 39: 1.015, 41: 1.0, 47: 1.01}
    studied = [
        dic.study.StudiedSettings(
            dic.CorrelationSettings(subset_px=subset_px, step_px=step_px), dic.StrainSettings(), 100.0,
            (0.0, 0.0), (0.0, 0.0), (slower * error, 0.0), (0.0, 0.0), 0.0,
        )
        for subset_px, error in errors.items()
        for step_px, slower in ((10, 1.0), (5, 1.019))
    ]  # fmt: skip
    times = {each.correlation.subset_px: each.subset_time for each in studied}
    assert times[41] == 3 * 41
    assert times[47] == 3 * 47
    assert 2.5 * 39 < times[39] < 3 * 39
    nothing = np.ones((9, 9), bool)
    study = dic.study.Study(
        tuple(studied), dic.study.Wave(), "given", 1.0, "reference", (), (), 0.0, 0, 9.0, nothing, None
    )
    assert study.best[0].correlation.subset_px == 41
    chosen = study.recommended.correlation
    assert (chosen.subset_px, chosen.step_px) == (39, 10)
