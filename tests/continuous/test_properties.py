"""Properties of continuous tests hold the truth in their intervals."""

import numpy as np
import pytest

from tests.continuous.specimens import LADDER, PULL, draw, measured

NAMES = ("E_gpa", "Rp02_mpa", "Rm_mpa")
MANY = 100


def deviations(folder, seed, phases):
    """Execute a test; return the deviations of E, Rp0.2 and Rm in standard deviations."""
    pulled, found = measured(folder, draw(seed), phases)
    assert pulled.outcome.status == "completed", pulled.outcome.reason
    exact = pulled.rig.exact_properties
    return [
        np.nan
        if found.values[name].std is None
        else (found.values[name].value - exact[name]) / found.values[name].std
        for name in NAMES
    ]


@pytest.mark.parametrize("phases", [PULL, pytest.param(LADDER, marks=pytest.mark.extended)])
def test_a_continuous_test_and_a_ladder_of_steps_show_the_properties(phases, tmp_path):
    assert np.abs(deviations(tmp_path, 1, phases)).max() < 3.5


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_95_percent_intervals_of_many_continuous_tests(tmp_path):
    found = np.array([deviations(tmp_path / str(seed), seed, PULL) for seed in range(MANY)])
    for name, pulls in zip(NAMES, found.T, strict=True):
        # A test without the value is none whose interval holds the truth.
        within, rms = np.mean(np.abs(pulls) <= 1.96), np.sqrt(np.nanmean(pulls**2))
        known = np.count_nonzero(np.isfinite(pulls))
        print(f"{name}: {known} of {MANY}, {within:.0%} within 95 %, rms z {rms:.2f}")
        assert 0.90 <= within <= 0.99
        assert 0.8 < rms < 1.2
