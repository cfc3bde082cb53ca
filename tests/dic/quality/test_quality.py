"""Tests of the quality of images whose speckles, noise, blur and clipping are known from formulas."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter
from scipy.special import erf

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.image.spline import spline_image
from dic.quality.findings import quality_findings
from dic.quality.noise import noise_of_one, noise_of_two
from dic.quality.noise_floor import predicted_std, squared_gradients
from dic.quality.quality import assess_quality
from dic.quality.speckle import autocovariance, edge_blur, even_light, speckle_size
from tests.dic.correlation.lattices import image, lattice

SMALL = CorrelationSettings(subset_px=21, step_px=12)


def blobs(sigma_px, shape=(400, 420), noise=0.0, seed=1):
    """Return an image of Gaussian blobs with the autocovariance 30² exp(-d² / 4 σ²) at the distance d."""
    rng = np.random.default_rng(seed)
    texture = gaussian_filter(rng.normal(size=shape), sigma_px)
    grey = 128 + 30 * texture / texture.std() + noise * rng.normal(size=shape)
    return grey.astype(np.float32)


def everywhere(grey):
    return np.ones(grey.shape, bool)


def edges(blur_px, shape=(300, 320), seed=2):
    """Return an image of bright boxes blurred by a Gaussian, whose edges are error functions."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    blur = np.broadcast_to(blur_px, shape) * np.sqrt(2)
    grey = np.full(shape, 40.0)
    for row in np.arange(15, shape[0] - 15, 30):
        for column in np.arange(15, shape[1] - 15, 30):
            cy, cx = row + rng.uniform(-0.5, 0.5), column + rng.uniform(-0.5, 0.5)
            box = (erf((y - cy + 7) / blur) - erf((y - cy - 7) / blur)) / 2
            grey += 160 * box * (erf((x - cx + 7) / blur) - erf((x - cx - 7) / blur)) / 2
    return grey.astype(np.float32)


class TestSpeckleSize:
    @pytest.mark.parametrize("noise", [0.0, 10.0])
    def test_is_the_full_width_at_half_maximum_on_either_axis(self, noise):
        grey = blobs((1.3, 2.6), (700, 720), noise)
        pattern, region = even_light(grey, everywhere(grey)), everywhere(grey)
        for axis, sigma in ((0, 1.3), (1, 2.6)):
            size = speckle_size(autocovariance(pattern, region, noise, axis))
            assert size == pytest.approx(4 * np.sqrt(np.log(2)) * sigma, rel=0.03)

    def test_of_sharp_dots_is_four_fifths_of_their_diameter(self):
        # The overlap of two discs of diameter D is half of one when they are 0.404 D apart.
        rng, diameter = np.random.default_rng(4), 9.0
        grey = np.zeros((700, 700), np.float32)
        for cx, cy in rng.uniform(10, 690, (2000, 2)):
            y, x = np.mgrid[int(cy) - 6 : int(cy) + 8, int(cx) - 6 : int(cx) + 8]
            grey[y, x] += np.hypot(x - cx, y - cy) < diameter / 2
        covariance = autocovariance(even_light(grey, everywhere(grey)), everywhere(grey), 0.0, 1)
        assert speckle_size(covariance) == pytest.approx(0.808 * diameter, rel=0.04)

    def test_is_the_same_under_uneven_light_and_in_a_part_of_the_image(self):
        grey = blobs(2.0)
        y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
        region = (x - 200) ** 2 + (y - 190) ** 2 < 170**2
        shaded = (grey + 0.0005 * (x - 100) ** 2 + 0.2 * y).astype(np.float32)
        shaded[~region] = 0
        size = speckle_size(autocovariance(even_light(shaded, region), region, 0.0, 1))
        assert size == pytest.approx(3.33 * 2.0, rel=0.05)


class TestNoise:
    @pytest.mark.parametrize("noise", [0.5, 2.0, 8.0])
    def test_of_one_image_is_that_which_was_added_and_the_rounding(self, noise):
        grey = np.rint(blobs(1.5, noise=noise))
        expected = np.sqrt(noise**2 + 1 / 12)
        assert noise_of_one(grey, everywhere(grey)) == pytest.approx(expected, rel=0.05)

    def test_of_two_images_leaves_out_light_and_a_small_motion(self):
        rng = np.random.default_rng(7)
        x = np.arange(420)
        clean = np.sin(x / 2.5) * np.sin(np.arange(400)[:, None] / 3.1)
        moved = np.sin((x - 0.05) / 2.5) * np.sin(np.arange(400)[:, None] / 3.1)
        first = (128 + 60 * clean + rng.normal(0, 1.5, clean.shape)).astype(np.float32)
        second = (1.1 * (120 + 60 * moved) + rng.normal(0, 1.5, clean.shape)).astype(np.float32)
        slopes = spline_image(first, 5).gradient()
        noise, whiteness = noise_of_two(first, second, slopes, everywhere(first))
        assert noise == pytest.approx(1.5, rel=0.05)
        assert whiteness == pytest.approx(1.0, abs=0.05)

    def test_that_a_camera_smoothed_is_noticed(self):
        rng = np.random.default_rng(8)
        clean = blobs(2.0)
        # A mean of 3 × 3 leaves a third of white noise.
        pair = [
            (clean + 3 * uniform_filter(2 * rng.normal(size=clean.shape), 3)).astype(np.float32) for _ in "ab"
        ]
        quality = assess_quality(pair[0], settings=SMALL, second=pair[1])
        assert quality.noise == pytest.approx(2.0, rel=0.05)
        assert any("smoothed" in sentence for sentence in quality_findings(quality))

    def test_of_two_images_that_differ_by_more_is_refused(self):
        first, other = blobs(2.0, seed=1), blobs(2.0, seed=2)
        with pytest.raises(CorrelationError, match="another picture"):
            assess_quality(first, settings=SMALL, second=other)
        with pytest.raises(CorrelationError, match="another picture"):
            assess_quality(first, settings=SMALL, second=np.full_like(first, 128.0))
        shifted = (first + 0.3 * spline_image(first, 5).gradient()[0]).astype(np.float32)
        with pytest.raises(CorrelationError, match=r"a motion of 0\.30 px"):
            assess_quality(first, settings=SMALL, second=shifted)


class TestFocus:
    @pytest.mark.parametrize(
        "blur_px", [0.7, *(pytest.param(blur_px, marks=pytest.mark.extended) for blur_px in (1.2, 2.0)), 3.0]
    )
    def test_blur_is_that_of_the_edges(self, blur_px):
        grey = edges(blur_px)
        assert edge_blur(grey, everywhere(grey), 0.0) == pytest.approx(blur_px, rel=0.15, abs=0.05)

    def test_noise_does_not_sharpen(self):
        grey = edges(1.5) + np.random.default_rng(3).normal(0, 4, (300, 320)).astype(np.float32)
        assert edge_blur(grey, everywhere(grey), 4.0) == pytest.approx(1.5, rel=0.15)

    @pytest.mark.extended
    def test_an_image_out_of_focus_and_one_that_is_so_at_a_side_are_told_apart(self):
        wide = CorrelationSettings(subset_px=61)
        everywhere_blurred = quality_findings(assess_quality(edges(3.0), settings=wide))
        assert any("px, more than 2 px; focus" in sentence for sentence in everywhere_blurred)
        x = np.arange(320)
        blurred_at_the_right = edges(np.where(x > 213, 3.0, 0.9))
        # The whole image is the region, so that one of its nine parts ends where the blur begins.
        region = everywhere(blurred_at_the_right)
        at_the_right = quality_findings(assess_quality(blurred_at_the_right, region, wide))
        assert any("right" in sentence and "stop down" in sentence for sentence in at_the_right)
        assert not any("focus" in s for s in quality_findings(assess_quality(edges(0.9), settings=wide)))


class TestNoiseFloor:
    def test_squared_gradients_of_a_wave_are_those_of_calculus(self):
        # A sin(2πx/7) has the mean squared slope (2πA/7)²/2 over the three periods in a subset.
        x, y = np.meshgrid(np.arange(100.0), np.arange(90.0))
        grey = (30 * np.sin(2 * np.pi * x / 7) + 20 * np.sin(2 * np.pi * y / 7)).astype(np.float32)
        found = squared_gradients(spline_image(grey, 5), np.array([[50, 45]]), everywhere(grey), 21)
        expected = [(2 * np.pi * a / 7) ** 2 / 2 * 21**2 for a in (30, 20)]
        np.testing.assert_allclose(found[0], expected, rtol=0.01)

    @pytest.mark.parametrize(("shape", "factor"), [("affine", 1.0), ("quadratic", np.sqrt(3.5))])
    def test_of_a_large_subset_is_pans_formula_times_the_price_of_the_shape_function(self, shape, factor):
        # Polynomials of second degree on a square have the variance 7/2 in its middle.
        grey = blobs(1.5, (500, 500))
        settings = CorrelationSettings(subset_px=61, shape=shape)
        points = np.stack(np.meshgrid([100, 200, 300, 400], [100, 200, 300, 400]), axis=-1).reshape(-1, 2)
        spline, region = spline_image(grey, 5), everywhere(grey)
        std = predicted_std(spline, 1.0, points, region, settings)
        pan = np.sqrt(2 / squared_gradients(spline, points, region, 61))
        assert np.mean(std / pan) == pytest.approx(factor, rel=0.06)

    @pytest.mark.parametrize(
        ("shape", "noise"),
        [("affine", 2.0), pytest.param("affine", 6.0, marks=pytest.mark.extended), ("quadratic", 2.0)],
    )
    def test_is_the_scatter_that_correlation_shows(self, speckle, shape, noise):
        settings = CorrelationSettings(subset_px=21, step_px=15, shape=shape)
        pattern = speckle(seed=31)
        clean, moved = pattern.draw(), pattern.draw(lambda x, y: (x - 0.37, y + 0.21))
        rng, errors, ratios = np.random.default_rng(9), [], []
        for _ in range(6):
            first, second = (
                (image + rng.normal(0, noise, image.shape)).astype(np.float32) for image in (clean, moved)
            )
            field = Correlator(first, everywhere(first), settings).correlate(second)
            error = np.stack([field.u_px - 0.37, field.v_px + 0.21], axis=-1)[field.converged]
            points = field.points[field.converged.ravel()].astype(int)
            spline, level = spline_image(first, settings.order), noise_of_one(first, everywhere(first))
            errors.append(error)
            ratios.append(error / predicted_std(spline, level, points, everywhere(first), settings))
        assert len(points) > 80
        np.testing.assert_allclose(np.std(np.concatenate(ratios), axis=0), 1, atol=0.1)
        quality = assess_quality(first, everywhere(first), settings)
        predicted = np.sqrt(np.mean(quality.std_px**2, axis=0))
        np.testing.assert_allclose(predicted, np.std(np.concatenate(errors), axis=0), rtol=0.2)

    @pytest.mark.extended
    def test_the_recommended_subset_resolves_what_is_wanted_and_a_smaller_one_does_not(self):
        grey = blobs(1.5, noise=4.0)
        quality = assess_quality(grey, settings=SMALL, wanted_px=0.01)
        best = quality.recommended_subset_px
        assert quality.subset_for_wanted_px == best
        for subset_px, enough in ((best, True), (best - 4, False)):
            other = assess_quality(grey, settings=CorrelationSettings(subset_px=subset_px), wanted_px=0.01)
            assert (other.floor_px <= 0.0101) is enough
        # The noise floor falls with the width of the subset.
        twice = assess_quality(grey, settings=SMALL, wanted_px=0.02).subset_for_wanted_px
        assert best / twice == pytest.approx(2, rel=0.2)

    def test_coarse_speckles_ask_for_a_subset_that_holds_three(self):
        quality = assess_quality(blobs(5.0), settings=SMALL, wanted_px=0.1)
        assert quality.subset_for_wanted_px < quality.recommended_subset_px
        assert quality.recommended_subset_px >= 3 * quality.speckle_x_px
        assert any("holds fewer than 3" in sentence for sentence in quality_findings(quality))


class TestLight:
    def test_clipped_pixels_are_counted_at_both_ends(self):
        grey = blobs(1.5, noise=1.0)
        low, high = np.percentile(grey, (6, 97))
        quality = assess_quality(np.clip(grey, low, high).astype(np.float32), settings=SMALL)
        assert quality.dark_share == pytest.approx(0.06, abs=0.001)
        assert quality.bright_share == pytest.approx(0.03, abs=0.001)
        assert sum("clipped" in sentence for sentence in quality_findings(quality)) == 2

    def test_contrast_compares_bright_with_dark(self):
        # 98 % and 2 % of a normal distribution lie 2.054 deviations of 30 from 128.
        quality = assess_quality(blobs(1.5), settings=SMALL)
        assert quality.contrast == pytest.approx(2.054 * 30 / 128, rel=0.03)
        dull = (1000 + blobs(1.5)).astype(np.float32)
        assert any(
            "contrast" in sentence for sentence in quality_findings(assess_quality(dull, settings=SMALL))
        )


@pytest.mark.extended
def test_a_good_image_has_no_findings_and_a_fine_pattern_has(speckle):
    grey = speckle(seed=3, noise=1.0).draw(noise_seed=1)
    good = assess_quality(grey)
    assert quality_findings(good) == []
    fine = assess_quality(blobs(0.6, noise=1.0), settings=SMALL)
    assert sum("finer than 3 px" in sentence for sentence in quality_findings(fine)) == 2


def test_subsets_without_a_pattern_are_said(speckle):
    grey = blobs(1.5, noise=1.0)
    grey[:, 280:] = 128 + np.random.default_rng(1).normal(0, 1, grey[:, 280:].shape)
    quality = assess_quality(grey, everywhere(grey), SMALL)
    assert quality.bare_share == pytest.approx(1 / 3, abs=0.1)
    assert any("no pattern beyond noise" in sentence for sentence in quality_findings(quality))
    assert np.isfinite(quality.floor_px)


class TestRefusals:
    def test_of_an_image_without_pattern(self):
        noise = np.random.default_rng(0).normal(100, 2, (200, 200)).astype(np.float32)
        with pytest.raises(CorrelationError, match="more than noise"):
            assess_quality(noise, everywhere(noise), SMALL)

    def test_of_a_small_region_and_a_small_image(self):
        region = np.zeros((400, 420), bool)
        region[5:15, 5:15] = True
        with pytest.raises(CorrelationError, match="holds subsets of 21 px"):
            assess_quality(blobs(2.0), region, SMALL)
        with pytest.raises(CorrelationError, match="an image of 40 x 36 px"):
            assess_quality(blobs(2.0, (36, 40)), None, SMALL)

    @pytest.mark.parametrize("wanted_px", [0.0, -1.0, float("nan")])
    def test_of_an_impossible_resolution(self, wanted_px):
        with pytest.raises(CorrelationError, match="wanted resolution"):
            assess_quality(blobs(2.0), None, SMALL, wanted_px=wanted_px)


class TestRepetition:
    def test_of_a_lattice_is_found_and_named_with_its_period(self):
        grey = image(lattice("square", 14.0, 0.3), (300, 300))
        quality = assess_quality(grey, everywhere(grey), SMALL)
        assert not quality.told_apart
        found = quality.as_dict()["repetition"]
        assert found["periods_px"] == pytest.approx([14.0, 14.0], rel=0.01)
        # An angle of 0.3 rad towards the y axis, which points down, is 180° - 17.2° as seen in the image.
        assert sorted(found["directions_deg"]) == pytest.approx([90 - 17.2, 180 - 17.2], abs=0.5)
        assert any("repeats every 14.0 px" in sentence for sentence in quality_findings(quality))

    @pytest.mark.parametrize("brightness", [0.0, 0.2])
    def test_is_no_fault_if_the_brightness_of_the_yarns_tells_the_periods_apart(self, brightness):
        cloth = lattice("plain", 9.0, 0.3, np.random.default_rng(1), brightness=brightness)
        grey = image(cloth, (300, 300))
        quality = assess_quality(grey, everywhere(grey), SMALL)
        assert quality.repetition is not None
        assert quality.told_apart == (brightness > 0)
        assert any("repeats" in sentence for sentence in quality_findings(quality)) == (brightness == 0)

    def test_is_not_said_of_random_speckles(self):
        quality = assess_quality(blobs(2.0), settings=SMALL)
        assert quality.as_dict()["repetition"] is None
