"""The predictions of a study are compared with the true errors on images of known deformation."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import dic
from benchmarks.speckle import Speckle, noisy, shift
from tests.dic.study import image_sets
from tests.dic.study.image_sets import ImageSet, key_of, predicted

PREDICTION, CHOICE = 0.15, 1.05
"""Limits: relative difference of predicted and true error; true error of the recommendation / smallest."""

DRAWN = ("of_dots", "of_short_waves", "of_coarse_speckles", "of_simulated_camera", "of_measured_field")


def studied(images: ImageSet, sweep: dic.study.Sweep) -> dic.study.Study:
    reference = images.pairs[0][0]
    wave = dic.study.Wave(**images.told) if images.told else None
    whole = np.ones(reference.shape, bool)
    return dic.study_settings(reference, images.images, region=whole, wave=wave, sweep=sweep)


def compare(images: ImageSet, sweep: dic.study.Sweep) -> tuple[np.ndarray, float, dic.study.Study]:
    """Return predicted / true strain error of all settings, and recommended / smallest true error."""
    study, true = studied(images, sweep), images.true_errors(sweep)
    found = predicted(study, images.components)
    assert len(found) > sweep.combinations / 2
    ratios = np.array([found[key][1] / true[key][1] for key in found])
    # A study recommends settings for both components of strain.
    whole = len(images.components) == 2
    best = key_of(study.recommended) if whole else min(found, key=lambda key: found[key][1])
    return ratios, true[best][1] / min(true[key][1] for key in found), study


def test_predicts_the_errors_of_images_that_it_has_not_seen():
    sweep = dic.study.Sweep((21, 31), (10,), (3, 5), ("quadratic",))
    ratios, choice, study = compare(image_sets.of_dots(2, (240, 250)), sweep)
    assert study.noise == pytest.approx(2.0, rel=0.05)
    assert np.abs(ratios - 1.0).max() < PREDICTION
    assert choice < CHOICE


@cache
def rest_and_load() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    speckle, wave = Speckle(31, (260, 260)), dic.study.Wave(120.0, 0.006)
    load = speckle.draw(lambda x, y: tuple(np.subtract((x, y), wave.origin(x, y, (0.0, 0.0)))))
    pictures = speckle.draw(), speckle.draw(shift(0.1, -0.05)), load
    return tuple(noisy(each, 3.0, seed) for seed, each in enumerate(pictures))


SMALL = dic.study.Sweep((31,), (10,), (3,), ("affine",))


def test_recognises_images_at_rest_and_takes_the_strain_of_a_deformed_one():
    reference, rest, load = rest_and_load()
    whole = np.ones(reference.shape, bool)
    study = dic.study_settings(reference, [load, rest], region=whole, sweep=SMALL)
    assert (study.wave_from, study.noise_from) == ("image 1", "image 2")
    assert "deformed" in study.notes[0]
    assert "at rest" in study.notes[1]
    assert study.wave.period_px == pytest.approx(120.0, rel=0.1)
    assert study.wave.strain_amplitude == pytest.approx(0.006, rel=0.1)


@pytest.mark.extended
def test_noise_of_a_pair_at_rest_is_that_of_drawn_noise():
    reference, rest, _ = rest_and_load()
    whole = np.ones(reference.shape, bool)
    noises = [
        dic.study_settings(reference, images, region=whole, sweep=SMALL).recommended.noise_px
        for images in ((), (rest,))
    ]
    assert noises[0] == pytest.approx(noises[1], rel=0.15)


def test_image_that_is_said_to_be_at_rest_and_is_not_is_refused():
    reference, _, load = rest_and_load()
    whole = np.ones(reference.shape, bool)
    with pytest.raises(
        dic.errors.CorrelationError, match="image 1: compare with the reference: expected the spec"
    ):
        dic.study_settings(reference, static=load, region=whole, sweep=SMALL)


@pytest.mark.extended
def test_smoothed_noise_is_measured_on_an_image_that_is_named():
    rng, picture = np.random.default_rng(8), Speckle(34, (260, 260)).draw()
    noises = [gaussian_filter(rng.normal(size=picture.shape), 0.9) for _ in range(7)]
    images = [(picture + 3.0 * each / each.std()).astype(np.float32) for each in noises]
    whole = np.ones(picture.shape, bool)
    study = dic.study_settings(images[0], static=images[1], region=whole, sweep=SMALL)
    assert study.noise_from == "image 1"
    found = study.recommended
    # other pairs of the same camera
    correlate = dic.Correlator(images[2], whole, found.correlation).correlate
    fields = [correlate(image) for image in images[3:]]
    scatter = np.std([[field.u_px, field.v_px] for field in fields])
    assert np.mean(found.noise_px) == pytest.approx(scatter, rel=0.15)
    # White noise of the same strength would do less.
    assert np.mean(found.noise_px) > 1.4 * np.mean([field.noise_std_px for field in fields])


def test_region_too_small_for_every_window_is_refused():
    reference, *_ = rest_and_load()
    region = np.zeros(reference.shape, bool)
    region[:70, :70] = True
    with pytest.raises(
        dic.errors.CorrelationError, match="try the settings: expected a part that holds complete"
    ):
        dic.study_settings(reference, region=region, sweep=dic.study.Sweep((31,), (15,), (5,)))


def check(images: ImageSet, sweep: dic.study.Sweep) -> None:
    ratios, choice, study = compare(images, sweep)
    print(
        f"\n{images.name}: {len(ratios)} settings, {ratios.min():.3f} to {ratios.max():.3f},"
        f" root mean square {np.sqrt(np.mean((ratios - 1) ** 2)):.3f}; choice {choice:.3f}"
        f" {key_of(study.recommended)}; noise {study.noise:.2f}; {study.wave}"
    )
    assert np.abs(ratios - 1.0).max() < PREDICTION
    assert choice < CHOICE


@pytest.mark.long
@pytest.mark.parametrize("name", DRAWN)
def test_prediction_and_choice_hold_on_drawn_images(name):
    check(getattr(image_sets, name)(), dic.study.Sweep())


@pytest.mark.long
@pytest.mark.parametrize("name", ["of_sharp_speckles", "of_much_noise"])
def test_prediction_and_choice_hold_on_sharp_and_on_noisy_patterns(name):
    check(getattr(image_sets, name)(), dic.study.Sweep((15, 21, 41, 61), (5, 10)))


@pytest.mark.long
def test_prediction_and_choice_hold_on_the_star_images(real_images):
    check(image_sets.of_star(real_images / "star2"), dic.study.Sweep())
