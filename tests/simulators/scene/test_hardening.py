"""The virtual specimen's laws of hardening are compared with explicit formulas."""

from math import exp, log

import numpy as np
import pytest
from pydantic import ValidationError

from simulators.scene.exact_properties import exact_properties
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings

SWIFT = {"law": "swift", "strength_mpa": 700.0, "offset_strain": 0.004, "exponent": 0.18}
VOCE = {"law": "voce", "initial_mpa": 300.0, "saturation_mpa": 550.0, "strain_scale": 0.06}
POINT = {"upper_mpa": 400.0, "lower_mpa": 375.0, "plateau_strain": 0.02}


def settings(**given):
    return SpecimenSettings.model_validate({"youngs_modulus_mpa": 205_000.0, "fracture_strain": 0.4} | given)


def curve(made, end_mm=30.0, step_mm=0.01):
    """Return strain, stress, width and thickness of a test at constant speed until the specimen breaks."""
    specimen, rows = SimulatedSpecimen(made), []
    for displacement_mm in np.arange(0.0, end_mm, step_mm):
        load_n = specimen.stretch_to(displacement_mm)
        if specimen.state.broken:
            break
        state = specimen.state
        rows.append(
            (state.axial_strain, load_n / made.area_mm2, state.transverse_strain, state.thickness_strain)
        )
    return np.array(rows).T


def test_swift_necks_where_considere_says():
    strain, stress, *_ = curve(settings(hardening=SWIFT))
    # d(true stress)/d(true strain) = true stress gives ln(1 + p) = n - offset
    uniform = 0.18 - 0.004
    exact = exact_properties(settings(hardening=SWIFT))
    assert exact["Rm_mpa"] == pytest.approx(700.0 * 0.18**0.18 / exp(uniform), rel=1e-12)
    assert exact["Ag_percent"] == pytest.approx(100 * (exp(uniform) - 1), rel=1e-9)
    assert stress.max() == pytest.approx(exact["Rm_mpa"], rel=1e-6)
    assert strain[np.argmax(stress)] == pytest.approx(exact["Agt_percent"] / 100, abs=5e-4)


def test_voce_necks_where_considere_says():
    exact = exact_properties(settings(hardening=VOCE))
    # (S - S0)/k exp(-e/k) = S - (S - S0) exp(-e/k)
    uniform = 0.06 * log(250.0 / 550.0 * (1 / 0.06 + 1))
    assert exact["Ag_percent"] == pytest.approx(100 * (exp(uniform) - 1), rel=1e-9)
    assert exact["Rm_mpa"] == pytest.approx((550.0 - 250.0 * exp(-uniform / 0.06)) / exp(uniform), rel=1e-12)


@pytest.mark.parametrize("law", [SWIFT, VOCE])
def test_the_curve_is_elastic_and_then_follows_the_law(law):
    strain, stress, *_ = curve(settings(hardening=law))
    plastic = strain - stress / 205_000.0
    true = np.log(1 + plastic)
    if law is SWIFT:
        expected, onset = 700.0 * (0.004 + true) ** 0.18, 700.0 * 0.004**0.18
    else:
        expected, onset = 550.0 - 250.0 * np.exp(-true / 0.06), 300.0
    flows = plastic > 1e-9
    np.testing.assert_allclose(stress[flows] * (1 + plastic[flows]), expected[flows], rtol=1e-9)
    assert np.all(plastic[stress < 0.999 * onset][:5] < 1e-12)
    assert flows.sum() > 1000


def test_proof_stress_leaves_two_per_mille():
    made = settings(hardening=SWIFT)
    strain, stress, *_ = curve(made, 3.0, 1e-3)
    found = np.interp(0.002, strain - stress / 205_000.0, stress)
    assert exact_properties(made)["Rp02_mpa"] == pytest.approx(found, rel=1e-6)


@pytest.mark.extended
def test_a_yield_point_drops_and_holds_the_stress():
    made = settings(hardening=SWIFT, yield_point=POINT)
    strain, stress, *_ = curve(made, step_mm=2e-3)
    exact = exact_properties(made)
    plastic = strain - stress / 205_000.0
    peak = int(np.argmax(plastic > 1e-6))
    assert stress[: peak + 1].max() == pytest.approx(400.0, rel=2e-3)
    np.testing.assert_allclose(stress[(plastic > 0.002) & (plastic < 0.02)], 375.0, rtol=1e-9)
    assert np.all(np.diff(strain) > 0)
    end = strain[np.flatnonzero(plastic < 0.02)[-1]]
    assert exact["Ae_percent"] == pytest.approx(100 * (end - 400.0 / 205_000.0), abs=0.02)
    assert (exact["ReH_mpa"], exact["ReL_mpa"], exact["Rp02_mpa"]) == (400.0, 375.0, None)
    assert stress.max() == pytest.approx(exact["Rm_mpa"], rel=1e-6)


@pytest.mark.parametrize("r", [0.6, 1.0, 2.5])
def test_the_ratio_of_plastic_strains_is_r_and_the_volume_is_kept(r):
    made = settings(hardening=SWIFT, strain_ratio=r)
    specimen = SimulatedSpecimen(made)
    specimen.stretch_to(6.0)
    specimen.stretch_to(0.0)
    state = specimen.state
    assert state.load_n == 0.0
    width, thickness = log(1 + state.transverse_strain), log(1 + state.thickness_strain)
    assert width / thickness == pytest.approx(r, rel=1e-12)
    assert width + thickness + log(1 + state.axial_strain) == pytest.approx(0.0, abs=1e-12)


def test_elastic_strain_narrows_width_and_thickness_alike():
    specimen = SimulatedSpecimen(settings(hardening=SWIFT, strain_ratio=2.0, poisson_ratio=0.29))
    specimen.stretch_to(0.3)
    state = specimen.state
    assert state.axial_strain == pytest.approx(state.load_n / 25.0 / 205_000.0, rel=1e-12)
    assert state.transverse_strain == pytest.approx(-0.29 * state.axial_strain, rel=1e-12)
    assert state.thickness_strain == state.transverse_strain


def test_unloading_on_the_plateau_is_elastic():
    specimen = SimulatedSpecimen(settings(hardening=SWIFT, yield_point=POINT))
    specimen.stretch_to(2.0)
    top = specimen.state
    specimen.stretch_to(1.9)
    below = specimen.state
    series = 60 / (205_000.0 * 25) + 1 / 15_000
    assert top.load_n - below.load_n == pytest.approx(0.1 / series)
    assert specimen.stretch_to(2.0) == pytest.approx(top.load_n)
    assert specimen.stretch_to(2.01) == pytest.approx(375.0 * 25)


def test_the_stress_of_ramberg_and_osgood_rises_until_the_break():
    strain, stress, *_ = curve(SpecimenSettings(), step_mm=1e-3)
    exact = exact_properties(SpecimenSettings())
    assert stress[-1] == pytest.approx(exact["Rm_mpa"], rel=1e-5)
    assert strain[-1] == pytest.approx(exact["Agt_percent"] / 100, abs=5e-5)
    assert exact["Rp02_mpa"] == 345.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"yield_point": POINT}, "yield_point needs a law in hardening"),
        ({"hardening": SWIFT, "yield_stress_mpa": 300.0}, "yield_stress_mpa has no effect beside hardening"),
        ({"hardening": SWIFT | {"law": "hollomon"}}, "swift"),
        ({"hardening": SWIFT, "yield_point": POINT | {"upper_mpa": 300.0}}, "upper_mpa must exceed"),
        (
            {"hardening": SWIFT, "yield_point": POINT | {"drop_strain": 1e-4}},
            "faster than the load frame can follow",
        ),
        ({"hardening": VOCE | {"saturation_mpa": 200.0}}, "saturation_mpa must exceed initial_mpa"),
        (
            {"hardening": VOCE | {"saturation_mpa": 301.0}, "yield_point": POINT},
            "does not rise behind the plateau",
        ),
    ],
)
def test_a_material_that_cannot_be_is_refused(given, words):
    with pytest.raises(ValidationError, match=words):
        settings(**given)
