"""Tests of extremes of noisy stresses, of curves with two maxima, and of large steps of strain."""

from dataclasses import replace

import numpy as np
import pytest

from dic import material_properties
from dic.properties import Curve, PropertySettings, with_shared_error
from tests.dic.properties.synthetic import strain_of_stress

E_MPA, AREA = 210e3, PropertySettings(20.0)


def steel(upper_mpa, strength_mpa, noise_mpa, seed, points=4000):
    """Return the properties of a noisy steel with a plateau 25 MPa below ReH and a flat maximum at 15 %."""
    strain = np.linspace(0.0, 0.20, points)
    lower = upper_mpa - 25.0
    corner = upper_mpa / E_MPA
    stress = np.interp(strain, [0.0, corner, corner + 8e-4], [0.0, upper_mpa, lower])
    hard = strain >= 0.02
    stress[hard] += (strength_mpa - lower) * (1 - (1 - (strain[hard] - 0.02) / 0.13) ** 2)
    rng = np.random.default_rng(seed)
    strain = strain + rng.normal(0, 2e-6, points)
    return material_properties(Curve("t", 20.0 * (stress + rng.normal(0, noise_mpa, points)), strain), AREA)


def test_stated_deviations_of_extremes_cover_what_noise_adds_to_them():
    errors = []
    for seed in range(8):
        values = steel(300.0, 340.0, 0.5, seed).values
        errors.append(
            [
                (values[name].value - truth) / values[name].std
                for name, truth in (("Rm_mpa", 340.0), ("ReL_mpa", 275.0))
            ]
        )
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    # An extreme of equal noisy values always lies on one side, so the ratio does not scatter around 0.
    assert (rms < 1.3).all()
    assert (rms > 0.6).all()


def test_the_maximum_of_uniform_elongation_is_not_mixed_with_the_upper_yield_point():
    for seed in range(6):
        found = steel(300.0, 300.0, 0.05, seed, 8000)
        agt = found.values["Agt_percent"]
        if agt.value is None:
            assert "maxim" in agt.flags[0] or "reached" in agt.flags[0]
        else:
            assert agt.value == pytest.approx(15.0, abs=4 * agt.std)
            assert agt.window["strain_percent"][1] - agt.window["strain_percent"][0] < 6.0


@pytest.mark.parametrize(("elastic", "plastic", "step"), [(60, 20, 0.01), (40, 15, 0.01), (30, 20, 0.005)])
def test_images_at_large_steps_of_plastic_strain_are_no_removal_of_the_extensometer(elastic, plastic, step):
    strain = np.concatenate([np.linspace(0, 0.003, elastic), 0.003 + step * np.arange(1, plastic + 1)])
    stress = np.interp(
        strain, strain_of_stress(np.linspace(0, 600, 6000), 70e3, 200.0, 8), np.linspace(0, 600, 6000)
    )
    found = material_properties(Curve("t", 20.0 * stress, strain), AREA)
    assert found.record.end == len(strain)
    assert found.flags == []


def test_necking_has_the_error_of_strain_that_agt_has():
    found = steel(300.0, 340.0, 0.5, 1)
    share = 0.02
    judged = with_shared_error(found, share * np.abs(found.record.curve.strain))
    # d ln(1 + e) = de / (1 + e)
    agt = judged.values["Agt_percent"].value / 100
    expected = share * agt / (1 + agt)
    assert judged.strain_parts["necking"] == pytest.approx(expected, rel=0.1)
    assert judged.necking.std == pytest.approx(np.hypot(found.necking.std, expected), rel=0.1)


def test_unread_loads_at_yielding_withhold_the_upper_yield_strength():
    curve = steel(300.0, 340.0, 0.0, 1).record.curve
    passed = np.full((4000, 2), np.nan)
    passed[int(np.argmax(curve.load_n[:400])) + 1] = 6100.0
    values = material_properties(replace(curve, passed_n=passed), AREA).values
    assert values["ReH_mpa"].value is None
    assert "has no strain" in values["ReH_mpa"].flags[0]
