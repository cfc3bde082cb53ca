"""Tests of the default settings: noise times resolution, and the same defaults in all places."""

import inspect

import numpy as np
import pytest

from benchmarks.choice import Choice, Wave, star_noise
from benchmarks.speckle import Speckle, noisy
from dic.correlation.settings import CorrelationSettings
from dic.quality.quality import assess_quality
from dic.specimen.find import find_specimen
from dic.strain.resolution import strain_resolution_px
from dic.strain.settings import StrainSettings


@pytest.mark.extended
def test_noise_times_resolution_squared_of_strain_is_small_at_defaults():
    """Resolution is that of a drawn wave without noise; noise is that of the star images, by theory."""
    choice, wave = Choice.default(), Wave(period_px=55.0, growth=0.1, middle_px=165.0)
    speckle = Speckle(seed=8, shape=(330, 900))
    still, waved = speckle.draw(), speckle.draw(wave.motion)
    resolution_px = wave.resolution_px(choice.measure((still.astype(np.float32), waved.astype(np.float32))))
    grey_levels = star_noise()
    pair = tuple(noisy(still, grey_levels, seed) for seed in (1, 2))
    strain = choice.measure(pair).strain
    noise = np.sqrt((np.nanvar(strain.exx) + np.nanvar(strain.eyy)) / 2)
    assert noise * resolution_px**2 < 3.5
    assert resolution_px == pytest.approx(
        strain_resolution_px(choice.correlation, StrainSettings()), rel=0.05
    )


def test_the_specimen_is_found_for_the_default_subset():
    default = inspect.signature(find_specimen).parameters["subset_px"].default
    assert default == CorrelationSettings().subset_px


def test_the_strain_error_of_interpolation_is_stated_for_the_default_gauge(speckle):
    judged = assess_quality(speckle(seed=5, shape=(160, 180)).draw())
    assert judged.interpolation.gauge_px == StrainSettings().gauge_px(CorrelationSettings())
