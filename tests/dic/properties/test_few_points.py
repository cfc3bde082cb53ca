"""Records with few points give right values, or no value and the reason."""

import numpy as np
import pytest

from dic import material_properties
from dic.properties import Curve, PropertySettings
from tests.dic.properties.synthetic import strain_of_stress

E_MPA, YIELD_MPA, HARDENING_MPA = 73.1e3, 345.0, 1500.0
AREA = PropertySettings(area_mm2=25.0)


def cornered(strain):
    """Return the stress of a material that yields at a sharp corner and then hardens linearly."""
    corner = YIELD_MPA / E_MPA
    return np.where(strain < corner, E_MPA * strain, YIELD_MPA + HARDENING_MPA * (strain - corner))


def level(strain):
    """Return the stress of a material with a yield plateau that ends at a strain of 1.5 %."""
    hard = np.maximum(strain - 0.015, 0.0)
    return np.minimum(E_MPA * strain, YIELD_MPA) + 150.0 * (1.0 - np.exp(-20.0 * hard))


def rounded(strain):
    """Return the stress by the law of Ramberg and Osgood."""
    stress = np.linspace(0.0, 3.0 * YIELD_MPA, 100_001)
    return np.interp(strain, strain_of_stress(stress, E_MPA, YIELD_MPA, 15), stress)


LAWS = {"sharp corner": cornered, "plateau": level, "Ramberg-Osgood": rounded}
# The stress at which the hardening of `cornered` meets the elastic line shifted by 0.2 %. For the other two
# laws, Rp0.2 is the yield stress by definition.
CORNERED = (YIELD_MPA * (1.0 - HARDENING_MPA / E_MPA) + 0.002 * HARDENING_MPA) / (1.0 - HARDENING_MPA / E_MPA)
OFFSET_MPA = {"sharp corner": CORNERED, "plateau": YIELD_MPA, "Ramberg-Osgood": YIELD_MPA}


def found(law, loaded_mpa, stretched, noise=0.0, seed=0):
    """Evaluate a record with points at the given stresses, and then at the strains `stretched` beyond."""
    grid = np.linspace(0.0, 0.006, 200_001)
    loaded = np.interp(loaded_mpa, LAWS[law](grid), grid)
    strain = np.concatenate([loaded, loaded[-1] + stretched])
    rng = np.random.default_rng(seed)
    seen = strain + rng.normal(0.0, noise, len(strain))
    return material_properties(Curve("made", 25.0 * LAWS[law](strain), seen), AREA).values


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("noise", [0.0, 3e-5])
@pytest.mark.parametrize("elastic", [3, 5, 6, 8])
@pytest.mark.parametrize(("more", "step"), [(7, 0.005), (40, 0.003)])
def test_few_elastic_points_give_no_slope_instead_of_a_wrong_one(law, noise, elastic, more, step):
    loaded = np.linspace(0.0, 0.85 * YIELD_MPA, elastic)
    values = found(law, loaded, step * np.arange(1.0, more + 1.0), noise)
    e_gpa = values["E_gpa"]
    if elastic < 8:
        assert e_gpa.value is None
    if e_gpa.value is None:
        assert e_gpa.flags[0].startswith("missing: ")
        assert "--window-mpa" in e_gpa.flags[0]
        assert values["Rp02_mpa"].value is None
    else:
        assert abs(e_gpa.value - E_MPA / 1e3) < max(3.0 * e_gpa.std, 0.01 * E_MPA / 1e3)


def test_the_tension_protocol_with_three_elastic_points_gives_no_slope():
    """The steps of examples/tension.toml: 2 kN on 25 mm², then 0.3 mm on 60 mm."""
    values = found("Ramberg-Osgood", [0.0, 80.0, 160.0, 240.0, 320.0], 0.005 * np.arange(1.0, 7.0))
    assert values["E_gpa"].value is None
    assert "few points in the elastic part" in values["E_gpa"].flags[0]
    assert values["Rm_mpa"].value is not None


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("step", [0.0005, 0.002, pytest.param(0.005, marks=pytest.mark.extended)])
@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.extended), 5e-6])
def test_twelve_elastic_points_and_large_plastic_steps_give_values_within_their_deviations(law, step, noise):
    loaded = np.linspace(0.0, 0.72 * YIELD_MPA, 12)
    for begin in (0.2, 0.5, 0.9):
        values = found(law, loaded, step * (begin + np.arange(14.0)), noise)
        e_gpa, offset = values["E_gpa"], values["Rp02_mpa"]
        assert abs(e_gpa.value - E_MPA / 1e3) < max(3.0 * e_gpa.std, 1e-5 * E_MPA / 1e3)
        assert abs(offset.value - OFFSET_MPA[law]) < max(3.0 * offset.std, 1e-4 * YIELD_MPA)


def test_deviation_of_an_offset_strength_shrinks_with_the_steps():
    loaded = np.linspace(0.0, 0.72 * YIELD_MPA, 12)
    stds = [
        found("Ramberg-Osgood", loaded, step * np.arange(1.0, 0.03 / step))["Rp02_mpa"].std
        for step in (0.003, 0.001, 0.0003)
    ]
    assert stds[0] > 5.0 * stds[1] > 10.0 * stds[2]
    assert stds[2] < 0.005 * YIELD_MPA


def test_noise_at_a_drop_of_few_points_does_not_end_the_search_for_a_plateau():
    stress = np.array([*np.linspace(0.0, 330.0, 12), 345.0, 341.0, 345.5, 346.0, 347.0, 348.0])
    strain = np.concatenate([stress[:12] / E_MPA, 0.006 + 0.005 * np.arange(6.0)])
    values = material_properties(Curve("made", 25.0 * stress, strain), AREA).values
    assert values["Rm_mpa"].value == pytest.approx(348.0)
    assert values["ReL_mpa"].value == pytest.approx(341.0)
